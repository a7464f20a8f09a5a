"""Coarser volumes from finer ones, with one or two directions a voxel.

Fiber length is conserved, and so is the second moment where the finer volume has one. One mean direction
makes of warp and weft in a voxel something between; two lobes, found as two clusters of axes as in Wu et al.
2016, keep them apart. The second lobe is a medium of its own on the same voxels, `<medium>_crossing`, so that
whoever draws overlapping media draws both.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .grid import BRICK_SIZE, FiberGrid, FiberVolume, empty_values

SECOND_LOBE = "_crossing"
ROUNDS = 4
"""Of sharing out the axes among two clusters."""
APART = 0.95
"""Two lobes whose axes have a larger cosine are one."""


@dataclass(frozen=True)
class _Children:
    """The occupied voxels of a finer grid, gathered by the coarse voxel that they lie in."""

    parents: np.ndarray
    """Coarse voxels, int64, shape [parent_count, 3]."""
    parent: np.ndarray
    """Row of each child's parent, shape [child_count]."""
    weight: np.ndarray
    """Volume fraction of each child, float64."""
    axis: np.ndarray
    """Its direction, float64, shape [child_count, 3]."""
    moment: np.ndarray
    """Its second moment, float64, shape [child_count, 3, 3]."""


def coarsen(volume: FiberVolume, *, lobes: int = 2) -> FiberVolume:
    """The volume on voxels twice as large, with one direction in each or two. Needs it in memory."""
    if lobes not in (1, 2):
        raise ValueError(f"a voxel has one lobe or two, not {lobes}")
    grids: dict[str, FiberGrid] = {}
    for name, grid in volume.grids.items():
        children = _gather(grid)
        shares = _two_lobes(children) if lobes == 2 else np.zeros(len(children.weight), dtype=bool)
        grids[name] = _merge(grid, children, ~shares)
        if lobes == 2:
            grids[name + SECOND_LOBE] = _merge(grid, children, shares)
    return FiberVolume(grids)


def _gather(grid: FiberGrid) -> _Children:
    brick, voxel = np.nonzero(grid.density)
    local = np.stack(np.unravel_index(voxel, (BRICK_SIZE,) * 3), axis=1)
    place = (grid.origins[brick].astype(np.int64) + local) // 2
    parents, parent = np.unique(place, axis=0, return_inverse=True)
    axis = grid.direction[brick, voxel].astype(np.float64)
    moment = axis[:, :, None] * axis[:, None, :]
    if grid.moment_diag is not None and grid.moment_off is not None:
        moment = symmetric(grid.moment_diag[brick, voxel], grid.moment_off[brick, voxel])
    weight = grid.density[brick, voxel].astype(np.float64)
    return _Children(parents, parent.reshape(-1), weight, axis, moment)


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


def _main_axis(matrices: np.ndarray) -> np.ndarray:
    """Eigenvector of the largest eigenvalue, in the hemisphere of `kernels.hemisphere`."""
    axis = np.linalg.eigh(matrices)[1][:, :, 2]
    last = np.where(axis[:, 2] != 0, axis[:, 2], np.where(axis[:, 1] != 0, axis[:, 1], axis[:, 0]))
    return np.where(last[:, None] < 0, -axis, axis)


def _two_lobes(children: _Children) -> np.ndarray:
    """Which children belong to their parent's second lobe, bool [child]; 2-means on axes.

    The first lobe begins as the main axis, the second as the axis that is worst served by it.
    """
    count, parent, axis, weight = len(children.parents), children.parent, children.axis, children.weight
    outer = weight[:, None, None] * axis[:, :, None] * axis[:, None, :]
    first = _main_axis(_sum_by(parent, count, outer))
    cosine = np.einsum("ij,ij->i", first[parent], axis)
    missed = weight * (1 - cosine**2)
    worst = np.lexsort((missed, parent))[np.cumsum(np.bincount(parent, minlength=count)) - 1]
    second = axis[worst]
    in_second = np.zeros(len(parent), dtype=bool)
    for _ in range(ROUNDS):
        near_first = np.abs(np.einsum("ij,ij->i", first[parent], axis))
        in_second = np.abs(np.einsum("ij,ij->i", second[parent], axis)) > near_first
        first = _main_axis(_sum_by(parent, count, outer * ~in_second[:, None, None]))
        second = _main_axis(_sum_by(parent, count, outer * in_second[:, None, None]))
    apart = np.abs(np.einsum("ij,ij->i", first, second)) < APART
    # of an empty cluster the axis says nothing
    apart &= _sum_by(parent, count, weight * ~in_second) > 0
    return in_second & apart[parent]


def _merge(fine: FiberGrid, children: _Children, chosen: np.ndarray) -> FiberGrid:
    """The grid of the chosen children: mean density, mean moment, main axis."""
    count = len(children.parents)
    weight = np.where(chosen, children.weight, 0.0)
    total = _sum_by(children.parent, count, weight)
    moment = _sum_by(children.parent, count, weight[:, None, None] * children.moment)
    held = np.flatnonzero(total)
    moment = moment[held] / total[held, None, None]
    bricks = children.parents[held] // BRICK_SIZE
    origins, brick = np.unique(bricks, axis=0, return_inverse=True)
    row = brick.reshape(-1), (children.parents[held] % BRICK_SIZE) @ np.array([64, 8, 1])
    arrays = {
        "density": empty_values(len(origins), "density"),
        "direction": empty_values(len(origins), "direction"),
    }
    arrays["density"][row] = total[held] / 8
    arrays["direction"][row] = _main_axis(moment)
    if fine.moment_diag is not None:
        for name, (i, j) in {
            "moment_diag": ([0, 1, 2], [0, 1, 2]),
            "moment_off": ([0, 0, 1], [1, 2, 2]),
        }.items():
            arrays[name] = empty_values(len(origins), name)
            arrays[name][row] = moment[:, i, j]
    return FiberGrid(
        voxel_size_mm=2 * fine.voxel_size_mm,
        fiber_radius_mm=fine.fiber_radius_mm,
        origins=(origins * BRICK_SIZE).astype(np.int32),
        **arrays,
    )


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
