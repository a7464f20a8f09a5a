"""A MERL table as measurements: one direction for the center of each cell that lies above the surface."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from weft.files.errors import InputError
from weft.files.measured.merl import (
    CELLS,
    SCALE,
    MerlTable,
    cell_of,
    center_directions,
    read_merl,
    write_merl,
)

from .measurements import Measurements
from .surface_directions import angles, vectors

NOT_MEASURED = -1.0
"""What is stored in cells for which there is no value."""


def read_merl_measurements(path: Path) -> Measurements:
    """The BRDF in RGB [1/sr]; cells that were not measured are there and not usable."""
    table = read_merl(path)
    light, detector = center_directions()
    above = (light[:, 2] > 0) & (detector[:, 2] > 0)
    (theta_i, phi_i), (theta_o, phi_o) = angles(light[above]), angles(detector[above])
    values = table.brdf().reshape(-1, 3)[above]
    return Measurements(
        theta_i=theta_i,
        phi_i=phi_i,
        theta_o=theta_o,
        phi_o=phi_o,
        values=values,
        quantity="brdf",
        usable=np.all(values >= 0, axis=1),
        channels=("r", "g", "b"),
        source=f"MERL table {path.name}",
    )


def write_merl_measurements(measurements: Measurements, path: Path) -> None:
    """Each row goes to the cell its directions fall in; two in one cell are refused, the rest not measured.

    Values that came from a .binary file are read back bit for bit, others to rounding.
    """
    if measurements.quantity != "brdf" or measurements.values.shape[1] != 3:
        raise InputError("a MERL table holds a 'brdf' in three channels", path=path)
    light = vectors(measurements.theta_i, measurements.phi_i)
    detector = vectors(measurements.theta_o, measurements.phi_o)
    cells = np.ravel_multi_index(cell_of(light, detector), CELLS)
    if len(np.unique(cells)) < len(cells):
        raise InputError("two directions fall in one cell of a MERL table", path=path)
    stored = measurements.values / SCALE
    if measurements.usable is not None:
        left_out = ~measurements.usable & (measurements.values >= 0).all(axis=1)
        stored[left_out] = NOT_MEASURED
    planes = np.full((3, CELLS[0] * CELLS[1] * CELLS[2]), NOT_MEASURED)
    planes[:, cells] = stored.T
    write_merl(MerlTable(planes.reshape(3, *CELLS)), path)
