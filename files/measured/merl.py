"""MERL's table of an isotropic BRDF (Matusik et al. 2003), the .binary files of the MERL BRDF database.

Three int32 (90, 90, 180), then a plane of float64 for red, green and blue: theta_h, theta_d, phi_d of
Rusinkiewicz (1998). Light and detector meet at the half vector h; d is the light seen from h. theta_h is
stored finer near the highlight, cell = 90 sqrt(theta_h / 90°); phi_d runs over half a turn, the other half
follows from reciprocity. Stored numbers times 1/1500, 1.15/1500, 1.66/1500 are the BRDF [1/sr]; negative
ones were not measured. Layout as read by wdas/brdf (BRDFMeasuredMERL.cpp, measured.func) and dj_brdf.h.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from weft.files.atomic import atomic_write
from weft.files.errors import InputError

from .binary_file import read_bytes, read_doubles, refuse_other_size

Array = NDArray[np.float64]

CELLS = (90, 90, 180)
"""Along theta_h, theta_d, phi_d."""
SCALE = np.array([1.0, 1.15, 1.66]) / 1500.0
"""From stored numbers to the BRDF [1/sr], for red, green, blue."""
HEADER_BYTES = 12
FILE_BYTES = HEADER_BYTES + 3 * 8 * 90 * 90 * 180


@dataclass(frozen=True)
class MerlTable:
    """The table as stored: `planes`, float64, shape [3, 90, 90, 180]; times `SCALE` it is the BRDF."""

    planes: Array

    def __post_init__(self) -> None:
        if self.planes.shape != (3, *CELLS) or self.planes.dtype != np.float64:
            raise ValueError("a MERL table has 3 x 90 x 90 x 180 float64")

    def brdf(self) -> Array:
        """BRDF [1/sr] in every cell, shape [90, 90, 180, 3]; negative where it was not measured."""
        return np.moveaxis(self.planes, 0, -1) * SCALE

    def evaluate(self, light: Array, detector: Array) -> Array:
        """BRDF [1/sr] of the cell that two unit vectors, shape [N, 3], fall in; shape [N, 3].

        Both point away from the surface, whose normal is z. 0 below the surface and where nothing was
        measured. No interpolation.
        """
        cells = np.ravel_multi_index(cell_of(light, detector), CELLS)
        found = self.planes.reshape(3, -1)[:, cells].T * SCALE
        seen = (light[:, 2] > 0) & (detector[:, 2] > 0) & (found >= 0).all(axis=1)
        return np.where(seen[:, None], found, 0.0)


def check_merl_header(path: Path) -> None:
    """Raises `InputError` for another size or another resolution; reads twelve bytes."""
    refuse_other_size(path, FILE_BYTES, "a MERL .binary file")
    cells = struct.unpack("<3i", read_bytes(path, HEADER_BYTES))
    if cells != CELLS:
        what = f"a table of {' x '.join(map(str, cells))} cells; MERL's have 90 x 90 x 180"
        raise InputError(what, path=path, place="byte 0")


def read_merl(path: str | Path) -> MerlTable:
    """Read a .binary file. Raises `InputError` for another size, another resolution, numbers not finite."""
    path = Path(path)
    check_merl_header(path)
    numbers = read_doubles(path, 3 * CELLS[0] * CELLS[1] * CELLS[2], start=HEADER_BYTES)
    return MerlTable(numbers.astype(np.float64, copy=False).reshape(3, *CELLS))


def write_merl(table: MerlTable, path: str | Path) -> None:
    """Write a .binary file; what `read_merl` read is written back bit for bit."""
    if not np.isfinite(table.planes).all():
        raise InputError("a MERL table needs finite numbers", path=path)
    with atomic_write(path) as temporary, open(temporary, "wb") as file:
        file.write(struct.pack("<3i", *CELLS))
        table.planes.astype("<f8", copy=False).tofile(file)


def cell_centers() -> tuple[NDArray[np.floating], NDArray[np.floating], NDArray[np.floating]]:
    """theta_h [90], theta_d [90] and phi_d [180] in the middle of each cell, radians."""
    theta_h = ((np.arange(90) + 0.5) / 90.0) ** 2 * (np.pi / 2)
    theta_d = (np.arange(90) + 0.5) / 90.0 * (np.pi / 2)
    phi_d = (np.arange(180) + 0.5) / 180.0 * np.pi
    return theta_h, theta_d, phi_d


def center_directions() -> tuple[Array, Array]:
    """Unit vectors toward light and detector of every cell's center, each of shape [1458000, 3].

    The half vector lies in the plane of x and z. Some of the vectors point below the surface.
    """
    theta_h, theta_d, phi_d = (x.ravel() for x in np.meshgrid(*cell_centers(), indexing="ij"))
    sine = np.sin(theta_d)
    d = np.stack([sine * np.cos(phi_d), sine * np.sin(phi_d), np.cos(theta_d)], axis=1)
    cos_h, sin_h = np.cos(theta_h), np.sin(theta_h)
    half = np.stack([sin_h, np.zeros_like(sin_h), cos_h], axis=1)
    light = np.stack([cos_h * d[:, 0] + sin_h * d[:, 2], d[:, 1], cos_h * d[:, 2] - sin_h * d[:, 0]], axis=1)
    return light, 2.0 * d[:, 2:] * half - light


def cell_of(light: Array, detector: Array) -> tuple[NDArray[np.intp], ...]:
    """Indices along theta_h, theta_d, phi_d of the cell that unit vectors of shape [N, 3] fall in."""
    half = light + detector
    across = np.hypot(half[:, 0], half[:, 1])
    theta_h = np.arctan2(across, half[:, 2])
    # d in the frame (u, v, h) with u away from the normal: its azimuth counts from the plane of incidence
    length = np.maximum(np.linalg.norm(half, axis=1), 1e-300)
    cos_h, sin_h = half[:, 2] / length, across / length
    lean = np.where(across[:, None] > 0, half[:, :2] / np.maximum(across, 1e-300)[:, None], [1.0, 0.0])
    along = lean[:, 0] * light[:, 0] + lean[:, 1] * light[:, 1]
    d_v = lean[:, 0] * light[:, 1] - lean[:, 1] * light[:, 0]
    d_u = cos_h * along - sin_h * light[:, 2]
    d_h = sin_h * along + cos_h * light[:, 2]
    theta_d = np.arctan2(np.hypot(d_u, d_v), d_h)
    phi_d = np.arctan2(d_v, d_u)
    phi_d = np.where(phi_d < 0, phi_d + np.pi, phi_d)  # light and detector exchanged
    cells = (90 * np.sqrt(theta_h * (2 / np.pi)), 90 * theta_d * (2 / np.pi), 180 * phi_d / np.pi)
    return tuple(np.clip(cell.astype(np.intp), 0, most - 1) for cell, most in zip(cells, CELLS, strict=True))
