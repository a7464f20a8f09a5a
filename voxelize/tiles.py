"""Which pieces of work touch which tile: boxes in mm against a lattice of tiles, in the order of space."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from .grid import BRICK_SIZE

EVERYWHERE = 2**50
"""Voxel coordinates are cut here, far outside what can be computed, so that float64 and int64 hold them."""


@dataclass(frozen=True)
class VoxelBox:
    """The voxels low <= (i, j, k) < high."""

    low: np.ndarray
    """int64, shape [3]."""
    high: np.ndarray
    """int64, shape [3]."""

    @property
    def is_empty(self) -> bool:
        return bool((self.low >= self.high).any())


@dataclass(frozen=True)
class TileWork:
    """One tile with the items whose boxes touch it."""

    origin: np.ndarray
    """First voxel of the tile, int64, shape [3]."""
    items: np.ndarray
    """Indices of the items, int64, ascending."""
    first_visit: np.ndarray
    """Whether no earlier tile holds the item, bool, like items."""


def voxel_boxes(bounds_mm: np.ndarray, voxel_size_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """First and one-past-last voxel of boxes [n, 2, 3] in mm, each float64 [n, 3].

    Widened by what float32 rounding may move a point inside a kernel.
    """
    scaled = bounds_mm.astype(np.float64) / voxel_size_mm
    margin = 0.01 + np.abs(scaled) * 2.0**-21
    return np.floor(scaled[:, 0] - margin[:, 0]), np.floor(scaled[:, 1] + margin[:, 1]) + 1.0


def snap_region(region_mm: tuple | None, voxel_size_mm: float) -> VoxelBox:
    """The region widened to whole voxels; everywhere where there is none."""
    if region_mm is None:
        limit = np.full(3, EVERYWHERE, dtype=np.int64)
        return VoxelBox(-limit, limit)
    corners = np.asarray(region_mm, dtype=np.float64) / voxel_size_mm
    # a corner that lies on a face up to rounding stays there
    low, high = np.floor(corners[0] + 1e-6), np.ceil(corners[1] - 1e-6)
    clipped = np.clip([low, high], -EVERYWHERE, EVERYWHERE).astype(np.int64)
    return VoxelBox(clipped[0], clipped[1])


def clip_boxes(low: np.ndarray, high: np.ndarray, box: VoxelBox) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Boxes that reach into `box`, cut to it: their indices, and low and high as int64 [m, 3]."""
    low, high = np.maximum(low, box.low), np.minimum(high, box.high)
    kept = np.flatnonzero((low < high).all(axis=1))
    return kept, low[kept].astype(np.int64), high[kept].astype(np.int64)


def cells_touched(low: np.ndarray, high: np.ndarray, cell: int) -> tuple[np.ndarray, np.ndarray]:
    """Every pair of box and cell (`cell` voxels wide) that overlap: box indices, and cells int64 [m, 3]."""
    first, last = low // cell, (high - 1) // cell
    shape = last - first + 1
    counts = shape.prod(axis=1)
    box = np.repeat(np.arange(len(low)), counts)
    number = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    size_y, size_z = shape[box, 1], shape[box, 2]
    steps = np.stack([number // (size_y * size_z), number // size_z % size_y, number % size_z], axis=1)
    return box, first[box] + steps


def tile_work(
    bounds_mm: np.ndarray, *, voxel_size_mm: float, region: VoxelBox, tile: int
) -> Iterator[TileWork]:
    """The tiles that boxes [n, 2, 3] touch inside the region, sorted by (x, y, z), each with its items.

    The lattice begins at the lowest brick, so that thin cloth is not cut in two without need.
    """
    kept, low, high = clip_boxes(*voxel_boxes(bounds_mm, voxel_size_mm), region)
    if not len(kept):
        return
    corner = low.min(axis=0) // BRICK_SIZE * BRICK_SIZE
    box, cells = cells_touched(low - corner, high - corner, tile)
    order = np.lexsort((box, cells[:, 2], cells[:, 1], cells[:, 0]))
    cells, items = cells[order], kept[box[order]]
    first_visit = np.zeros(len(items), dtype=bool)
    first_visit[np.unique(items, return_index=True)[1]] = True
    starts = np.flatnonzero(np.r_[True, (np.diff(cells, axis=0) != 0).any(axis=1)])
    for begin, end in zip(starts, np.r_[starts[1:], len(items)], strict=True):
        yield TileWork(corner + cells[begin] * tile, items[begin:end], first_visit[begin:end])
