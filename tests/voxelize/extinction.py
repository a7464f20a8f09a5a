"""Extinction of volumes by numpy, slowly, to compare with what the coarser levels say of themselves."""

from __future__ import annotations

import numpy as np

from weft.voxelize.grid import BRICK_SIZE, FiberVolume


def symmetric(diagonal: np.ndarray, off: np.ndarray) -> np.ndarray:
    """Matrices [n, 3, 3] from xx, yy, zz and xy, xz, yz."""
    matrix = np.empty((len(diagonal), 3, 3))
    matrix[:, [0, 1, 2], [0, 1, 2]] = diagonal
    matrix[:, [0, 0, 1], [1, 2, 2]] = matrix[:, [1, 2, 2], [0, 0, 1]] = off
    return matrix


def _sum_by(parent: np.ndarray, count: int, values: np.ndarray) -> np.ndarray:
    """Sums of values [child, ...] over the children of each parent."""
    flat = values.reshape(len(values), -1)
    sums = [np.bincount(parent, weights=column, minlength=count) for column in flat.T]
    return np.stack(sums, axis=-1).reshape(count, *values.shape[1:])


def extinction_by_voxel(
    volume: FiberVolume, w: np.ndarray, *, voxel: int
) -> dict[tuple[int, ...], np.ndarray]:
    """Mean sigma_t [1/mm] by direction, over cubes of `voxel` voxels: corner (in cubes) -> [direction].

    `w` are unit vectors [direction, 3]; media are added up.
    """
    found: dict[tuple[int, ...], np.ndarray] = {}
    for grid in volume.grids.values():
        brick, place = np.nonzero(grid.density)
        local = np.stack(np.unravel_index(place, (BRICK_SIZE,) * 3), axis=1)
        cubes, row = np.unique((grid.origins[brick] + local) // voxel, axis=0, return_inverse=True)
        sine = np.sqrt(np.clip(1 - (grid.direction[brick, place] @ w.T) ** 2, 0, 1))
        scale = 2 / (np.pi * grid.fiber_radius_mm) * grid.density[brick, place].astype(np.float64)
        sums = _sum_by(row.reshape(-1), len(cubes), scale[:, None] * sine) / voxel**3
        for cube, value in zip(map(tuple, cubes.tolist()), sums, strict=True):
            found[cube] = found.get(cube, 0.0) + value
    return found


def extinction_error(fine: FiberVolume, coarse: FiberVolume, w: np.ndarray) -> tuple[float, float]:
    """Mean and root mean square of coarse / fine - 1 over voxels and directions, weighted by extinction."""
    factor = round(coarse.voxel_size_mm / fine.voxel_size_mm)
    before, after = extinction_by_voxel(fine, w, voxel=factor), extinction_by_voxel(coarse, w, voxel=1)
    cubes = list(before)
    truth, made = np.stack([before[cube] for cube in cubes]), np.stack([after[cube] for cube in cubes])
    relative = made / np.maximum(truth, 1e-12) - 1
    return float(np.average(relative, weights=truth)), float(np.sqrt(np.average(relative**2, weights=truth)))
