"""UTIA's tables of anisotropic BRDFs (Filip and Vavra 2014), the .bin files of the UTIA BRDF database.

No header: three planes of float64, red, green, blue, each 288 x 288. A row is a direction of the light, a
column one of the detector, both counted as azimuth + 48 inclination: inclinations 0, 15 … 75 degrees from
the normal, azimuths 0, 7.5 … 352.5. The numbers are right up to a factor (dj_brdf.h scales each material
so that it gains no energy); some materials have negative ones, which are taken as not measured.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from weft.files.atomic import atomic_write
from weft.files.errors import InputError
from weft.files.measured.binary_file import read_doubles, refuse_other_size

from .measurements import Array, Measurements

INCLINATIONS, AZIMUTHS = 6, 48
DIRECTIONS = INCLINATIONS * AZIMUTHS
THETA_STEP, PHI_STEP = np.deg2rad(15.0), np.deg2rad(7.5)
FILE_BYTES = 3 * 8 * DIRECTIONS**2
ON_GRID = 1e-6
"""How far from a direction of the grid a measurement may lie [rad]."""


def read_utia(path: Path) -> Measurements:
    """The BRDF in RGB up to a factor; 82,944 directions, those with a negative value not usable."""
    refuse_other_size(path, FILE_BYTES, "a UTIA .bin file")
    values = read_doubles(path, 3 * DIRECTIONS**2).astype(np.float64, copy=False).reshape(3, -1).T.copy()
    direction = np.arange(DIRECTIONS)
    theta, phi = np.deg2rad(direction // AZIMUTHS * 15.0), np.deg2rad(direction % AZIMUTHS * 7.5)
    return Measurements(
        theta_i=np.repeat(theta, DIRECTIONS),
        phi_i=np.repeat(phi, DIRECTIONS),
        theta_o=np.tile(theta, DIRECTIONS),
        phi_o=np.tile(phi, DIRECTIONS),
        values=values,
        quantity="brdf",
        scale_known=False,
        usable=np.all(values >= 0, axis=1),
        channels=("r", "g", "b"),
        source=f"UTIA table {path.name}",
    )


def write_utia(measurements: Measurements, path: Path) -> None:
    """Write measurements in all directions of the grid, in any order; what was read, bit for bit."""
    if measurements.quantity != "brdf" or measurements.values.shape[1] != 3:
        raise InputError("a UTIA table holds a 'brdf' in three channels", path=path)
    light = _direction(measurements.theta_i, measurements.phi_i, path)
    detector = _direction(measurements.theta_o, measurements.phi_o, path)
    cells = light * DIRECTIONS + detector
    if len(cells) != DIRECTIONS**2 or len(np.unique(cells)) != DIRECTIONS**2:
        what = f"a UTIA table has each of {DIRECTIONS**2} pairs of directions once; there are {len(cells)}"
        raise InputError(what, path=path)
    planes = np.empty((3, DIRECTIONS**2), dtype="<f8")
    planes[:, cells] = measurements.values.T
    with atomic_write(path) as temporary, open(temporary, "wb") as file:
        planes.tofile(file)


def _direction(theta: Array, phi: Array, path: Path) -> NDArray[np.intp]:
    """Number of each direction on the grid."""
    inclination, azimuth = np.rint(theta / THETA_STEP), np.rint(phi / PHI_STEP)
    off = np.maximum(np.abs(theta - inclination * THETA_STEP), np.abs(phi - azimuth * PHI_STEP))
    outside = (inclination < 0) | (inclination >= INCLINATIONS)
    if (bad := (off > ON_GRID) | outside).any():
        row = int(np.argmax(bad))
        shown = f"theta {np.rad2deg(theta[row]):g}, phi {np.rad2deg(phi[row]):g}"
        raise InputError(f"direction {shown} degrees is none of UTIA's grid", path=path)
    return (inclination * AZIMUTHS + azimuth % AZIMUTHS).astype(np.intp)
