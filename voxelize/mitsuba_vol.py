"""A crop of a volume as Mitsuba 3 `gridvolume` files: extinction, and the six channels of its `sggx` phase.

SGGX (Heitz et al. 2015) with S = I - T has the projected area sqrt(w^T S w), so that Mitsuba's medium with
these two grids has sigma_t = 2 a lambda sqrt(w^T (I - T) w).
Format: "VOL", version 3, encoding 1 (float32), size x y z, channels, box; x runs fastest, channels innermost.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from weft.files.atomic import atomic_write
from weft.files.errors import InputError

from .grid import BRICK_SIZE, FiberGrid, FiberVolume
from .tiles import snap_region

MAX_VOXELS = 2**28
PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""Order of Mitsuba's channels: Sxx, Syy, Szz, Sxy, Sxz, Syz."""

Box = tuple[tuple[float, float, float], tuple[float, float, float]]


def write_vol(extinction: str | Path, sggx: str | Path, volume: FiberVolume, box_mm: Box) -> None:
    """Write the voxels of a box, widened to whole ones: sigma_t [1/mm] across the fibers, and S.

    Media are added up. Without a second moment T is that of the direction. Raises `InputError` where the box
    holds too many voxels.
    """
    region = snap_region(box_mm, volume.voxel_size_mm)
    shape = tuple(int(size) for size in region.high - region.low)
    if np.prod(shape, dtype=float) > MAX_VOXELS:
        raise InputError(
            f"{shape} voxels are more than a dense .vol file of {MAX_VOXELS}; take a smaller box."
        )
    sigma, moment = np.zeros(shape), np.zeros((*shape, 6))
    for grid in volume.grids.values():
        _add(grid, region.low, sigma, moment)
    held = sigma > 0
    projected = np.tile(np.array([1.0, 1, 1, 0, 0, 0]), (*shape, 1))
    projected[held] -= moment[held] / sigma[held][:, None]
    corners = np.stack([region.low, region.high]) * volume.voxel_size_mm
    _write(Path(extinction), sigma[..., None], corners)
    _write(Path(sggx), projected, corners)


def _add(grid: FiberGrid, low: np.ndarray, sigma: np.ndarray, moment: np.ndarray) -> None:
    """Add sigma_t of one medium, and its T times sigma_t."""
    brick, voxel = np.nonzero(grid.density)
    local = np.stack(np.unravel_index(voxel, (BRICK_SIZE,) * 3), axis=1)
    place = grid.origins[brick] + local - low
    inside = ((place >= 0) & (place < sigma.shape)).all(axis=1)
    brick, voxel, at = brick[inside], voxel[inside], tuple(place[inside].T)
    value = 2 * grid.density[brick, voxel].astype(np.float64) / (np.pi * grid.fiber_radius_mm)
    if grid.moment_diag is not None and grid.moment_off is not None:
        t = np.concatenate([grid.moment_diag[brick, voxel], grid.moment_off[brick, voxel]], axis=1)
    else:
        axis = grid.direction[brick, voxel]
        t = np.stack([axis[:, i] * axis[:, j] for i, j in PAIRS], axis=1)
    sigma[at] += value
    moment[at] += value[:, None] * t


def _write(path: Path, values: np.ndarray, corners: np.ndarray) -> None:
    """Values [x, y, z, channel] over the box with these corners [mm]."""
    head = b"VOL\3" + struct.pack("<5i", 1, *values.shape) + struct.pack("<6f", *corners.ravel())
    with atomic_write(path) as temporary:
        temporary.write_bytes(
            head + np.ascontiguousarray(values.transpose(2, 1, 0, 3), dtype="<f4").tobytes()
        )
