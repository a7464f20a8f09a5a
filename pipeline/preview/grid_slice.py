"""Pieces of a sparse volume as plain arrays: planes of density, a coarse block, directions on a subsample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from weft.voxelize.grid import BRICK_SIZE, FiberGrid, FiberVolume


@dataclass(frozen=True)
class Region:
    """A box of whole bricks, in voxels: [low, high), multiples of 8."""

    low: np.ndarray
    high: np.ndarray

    @property
    def shape(self) -> np.ndarray:
        return self.high - self.low

    def bounds_mm(self, voxel_size_mm: float) -> np.ndarray:
        """Corners [mm], shape [2, 3]."""
        return np.stack([self.low, self.high]) * voxel_size_mm


def region_of(volume: FiberVolume, box: np.ndarray | None) -> Region | None:
    """The bricks of the volume, or those that touch `box` [mm]; None where there are none."""
    corners = volume.bounds_mm
    if box is not None:
        corners = np.stack([np.maximum(corners[0], box[0]), np.minimum(corners[1], box[1])])
    brick = BRICK_SIZE * volume.voxel_size_mm
    low = np.floor(corners[0] / brick + 1e-6).astype(np.int64) * BRICK_SIZE
    high = np.ceil(corners[1] / brick - 1e-6).astype(np.int64) * BRICK_SIZE
    return Region(low, high) if (low < high).all() else None


def density_plane(volume: FiberVolume, region: Region, axis: int, index: int, stride: int) -> np.ndarray:
    """Density of all media in the voxels `index` along `axis`, averaged over stride x stride cells.

    float32, shape of the region's two other axes over `stride` (1, 2, 4 or 8).
    """
    others = [i for i in range(3) if i != axis]
    plane = np.zeros(region.shape[others] // stride, np.float32)
    layer = index // BRICK_SIZE * BRICK_SIZE
    for grid in volume.grids.values():
        chosen = _bricks_in(grid, region) & (grid.origins[:, axis] == layer)
        patches = _cubes(grid, chosen).take(index - layer, axis=1 + axis)
        _add_patches(plane, patches, grid.origins[chosen][:, others] - region.low[others], stride)
    return plane


def density_block(volume: FiberVolume, region: Region, stride: int) -> np.ndarray:
    """Density of all media, averaged over stride^3 cells, float32, shape of the region over `stride`."""
    block = np.zeros(region.shape // stride, np.float32)
    for grid in volume.grids.values():
        chosen = _bricks_in(grid, region)
        _add_patches(block, _cubes(grid, chosen), grid.origins[chosen] - region.low, stride)
    return block


def plane_directions(
    grid: FiberGrid, region: Region, axis: int, index: int, every: int
) -> tuple[np.ndarray, np.ndarray]:
    """Centers [mm] and directions of the filled voxels of a plane that lie on a lattice, every n-th voxel."""
    layer = index // BRICK_SIZE * BRICK_SIZE
    others = [i for i in range(3) if i != axis]
    chosen = np.flatnonzero(_bricks_in(grid, region) & (grid.origins[:, axis] == layer))
    local = np.argwhere(_cubes(grid, chosen).take(index - layer, axis=1 + axis) > 0)
    voxel = np.empty((len(local), 3), np.int64)
    voxel[:, axis] = index
    voxel[:, others] = grid.origins[chosen][local[:, 0]][:, others] + local[:, 1:]
    wanted = ((voxel[:, others] - every // 2) % every == 0).all(axis=1)
    brick, voxel = chosen[local[wanted, 0]], voxel[wanted]
    inside = voxel % BRICK_SIZE
    direction = grid.direction[brick, (inside[:, 0] * BRICK_SIZE + inside[:, 1]) * BRICK_SIZE + inside[:, 2]]
    return ((voxel + 0.5) * grid.voxel_size_mm).astype(np.float32), direction


def _bricks_in(grid: FiberGrid, region: Region) -> np.ndarray:
    return np.all((grid.origins >= region.low) & (grid.origins < region.high), axis=1)


def _cubes(grid: FiberGrid, chosen: np.ndarray) -> np.ndarray:
    return grid.density[chosen].reshape(-1, BRICK_SIZE, BRICK_SIZE, BRICK_SIZE)


def _add_patches(target: np.ndarray, patches: np.ndarray, origins: np.ndarray, stride: int) -> None:
    """Add patches of 8 cells along each axis, averaged over `stride` cells, at `origins` [voxels]."""
    cells, dimensions = BRICK_SIZE // stride, patches.ndim - 1
    split = patches.reshape(len(patches), *[cells, stride] * dimensions)
    means = split.mean(axis=tuple(range(2, 2 * dimensions + 1, 2)))
    index = []
    for i in range(dimensions):
        shape = [1] * dimensions
        shape[i] = cells
        begin = (origins[:, i] // stride).reshape(-1, *[1] * dimensions)
        index.append(begin + np.arange(cells).reshape(1, *shape))
    target[tuple(index)] += means  # bricks of one grid do not overlap
