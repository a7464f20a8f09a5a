"""Fiber grids as the kernel reads them: a dense grid of cells over pages of quantized bricks.

A cell is the place of one brick of 8 x 8 x 8 voxels. Its word in `cells` says
- occupied: bit 31 clear, bits 28..30 the number of layers less one, bits 0..27 the first brick. The bricks of
  one cell (one per medium that has fiber there) follow each other, so overlapping media add exactly. Where
  bricks are of several levels (volume_levels.py), bits 25..27 are theirs: voxels 2^level times as large, in a
  brick that all cells which it covers name;
- empty: bit 31 set, bits 0..15 the Chebyshev radius r in cells such that the (2r+1)^3 cells around it are
  empty, so a ray crosses the whole box in one step (proximity clouds, Cohen and Sheffer 1994).

A voxel word is 12 bits of density over 10 + 10 bits of direction (hemi-octahedral). A voxel without fiber
keeps in bits 0..2 the radius of the empty box around it within its brick. The scale of each brick is chosen
so that the sum of its densities is kept exactly, and its majorant is that of the stored values. Where grids
have colors, 512 words of dye follow the words of each brick (voxel_colors.py).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from weft.files.errors import DeviceMemoryError, InputError
from weft.voxelize.grid import BRICK_SIZE, BRICK_VOXELS, FiberGrid

from .direction_encoding import DIRECTION_BITS, encode_axis
from .voxel_colors import WHITE, color_words

DENSITY_LEVELS = (1 << 12) - 1
EMPTY_CELL = 1 << 31
MAX_LAYERS = 8
MAX_CELLS = 1 << 28
MAX_EMPTY_RADIUS_IN_BRICK = 7
BRICKS_PER_CHUNK = 2048
LEVEL_SHIFT = 25
"""Of a cell's word, where bricks are of several levels."""
SMALL_GRID = 1 << 22
"""Cells times those along the longest side, up to which empty boxes are found without scipy."""


class VoxelRows(Protocol):
    """Voxel words of bricks, in memory or on the disk."""

    def __len__(self) -> int: ...
    def __getitem__(self, bricks: Any) -> np.ndarray: ...


@dataclass(frozen=True)
class LevelShare:
    """What of a volume is drawn at one level of detail."""

    level: int
    voxel_size_mm: float
    brick_count: int
    fiber_share: float
    """Of all fiber that is drawn."""
    extinction_error_rms: float | None
    """Relative, against the finest voxels, as voxelize measured it; None where it is not known."""


@dataclass(frozen=True)
class BrickPool:
    """Media superposed on one lattice. Lengths in voxels, from the pool's corner at `origin`."""

    voxel_size_mm: float
    origin: np.ndarray
    """Lattice coordinates of voxel (0, 0, 0) of the pool, int64, shape [3]."""
    cells: np.ndarray
    """One word per cell, uint32, shape [nx, ny, nz]."""
    voxels: VoxelRows
    """Quantized voxels in the order of `FiberGrid`, uint32, shape [brick_count, 512], or 1024 with colors."""
    density_step: np.ndarray
    """Volume fraction of one density level, per brick, float32, shape [brick_count]."""
    majorant_level: np.ndarray
    """Largest density level, per brick, uint32, shape [brick_count]."""
    medium: np.ndarray
    """Index of the medium of each brick, uint32, shape [brick_count]."""
    fiber_radius_mm: np.ndarray
    """Per medium, float64, shape [medium_count]."""
    layer_count: int
    """Largest number of media in one cell."""
    has_colors: bool = False
    """Whether words of dye follow those of each brick."""
    coarsest_level: int = 0
    """Of its bricks; 0: all have the same voxels."""
    detail: tuple[LevelShare, ...] = ()
    """How much of it is drawn at which level, where levels were chosen."""

    @property
    def brick_words(self) -> int:
        """Words of one brick in `voxels`."""
        return BRICK_VOXELS * (2 if self.has_colors else 1)

    @property
    def size(self) -> np.ndarray:
        """Extent in voxels, int64, shape [3]."""
        return np.array(self.cells.shape, np.int64) * BRICK_SIZE

    @property
    def corner_mm(self) -> np.ndarray:
        """World place of the pool's lower corner [mm]."""
        return self.origin * self.voxel_size_mm

    @property
    def byte_count(self) -> int:
        """Bytes on the device."""
        return self.cells.nbytes + (4 * self.brick_words + 8) * len(self.voxels)


@dataclass(frozen=True)
class BrickOrder:
    """Where bricks lie in the grid, and their order in the pool."""

    origin: np.ndarray
    cells: np.ndarray
    order: np.ndarray
    """Which of the given bricks is the n-th of the pool, int64, shape [brick_count]."""
    medium: np.ndarray
    layer_count: int


def build_brick_pool(grids: Sequence[FiberGrid]) -> BrickPool:
    """Superpose the grids, one medium each, in order. Raises `InputError` for what cannot be rendered."""
    voxel_size = _common_voxel_size(grids)
    for index, grid in enumerate(grids):
        check_values(grid, index)
    places = arrange_bricks([grid.origins for grid in grids])
    voxels, step, level = _quantize(grids, places.order)
    return BrickPool(
        voxel_size_mm=voxel_size,
        origin=places.origin,
        cells=places.cells,
        voxels=voxels,
        density_step=step,
        majorant_level=level,
        medium=places.medium,
        fiber_radius_mm=np.array([grid.fiber_radius_mm for grid in grids]),
        layer_count=places.layer_count,
        has_colors=any(grid.albedo is not None for grid in grids),
    )


def arrange_bricks(media: Sequence[np.ndarray]) -> BrickOrder:
    """The grid of cells over all bricks. `media`: first voxels of the bricks of each, int32, shape [n, 3]."""
    medium = np.concatenate([np.full(len(origins), i, np.uint32) for i, origins in enumerate(media)])
    places = np.concatenate([np.asarray(origins, np.int64) for origins in media]) // BRICK_SIZE
    low = places.min(axis=0)
    shape = tuple(int(n) for n in places.max(axis=0) - low + 1)
    refuse_too_many_cells(shape)
    flat = np.ravel_multi_index(tuple((places - low).T), shape)
    order = np.lexsort((medium, flat))
    flat, medium = flat[order], medium[order]
    cells, layer_count = _link_cells(flat, medium, shape)
    return BrickOrder(low * BRICK_SIZE, cells, order, medium, layer_count)


def refuse_too_many_cells(shape: tuple[int, ...]) -> None:
    """Raise `DeviceMemoryError` for a lattice of more cells than the kernel can number."""
    if np.prod(shape, dtype=float) > MAX_CELLS:
        raise DeviceMemoryError(
            f"render: the volume spans {shape} bricks, more than the renderer's {MAX_CELLS}.",
            hint="Raise voxelize.voxel_size_mm.",
        )


def _common_voxel_size(grids: Sequence[FiberGrid]) -> float:
    if not grids or not any(len(grid.origins) for grid in grids):
        raise InputError("render: the volume holds no fiber.", hint="Check yarns and voxelize.")
    sizes = sorted({float(grid.voxel_size_mm) for grid in grids})
    if len(sizes) > 1:
        raise InputError(f"render: the media have different voxel sizes {sizes} mm; they need one.")
    if not (np.isfinite(sizes[0]) and sizes[0] > 0):
        raise InputError(f"render: voxel size is {sizes[0]} mm; it must be a positive length.")
    return sizes[0]


def check_values(grid: FiberGrid, index: int) -> None:
    """Raise `InputError` for what cannot be rendered."""
    if not (np.isfinite(grid.fiber_radius_mm) and grid.fiber_radius_mm > 0):
        raise InputError(
            f"render: medium {index} has fiber radius {grid.fiber_radius_mm} mm; it must be positive."
        )
    if np.any(np.asarray(grid.origins) % BRICK_SIZE):
        raise InputError(
            f"render: medium {index} has bricks that do not start at a multiple of {BRICK_SIZE} voxels."
        )
    # min and max propagate NaN, and make no temporary of the grid's size
    if len(grid.density) and not (grid.density.min() >= 0 and grid.density.max() < np.inf):
        raise InputError(f"render: medium {index} has densities that are negative or not finite.")
    if len(grid.direction) and not (grid.direction.min() > -np.inf and grid.direction.max() < np.inf):
        raise InputError(f"render: medium {index} has directions that are not finite.")


def _link_cells(flat: np.ndarray, medium: np.ndarray, shape: tuple[int, ...]) -> tuple[np.ndarray, int]:
    """Words of all cells from the sorted cell numbers of the bricks, and the largest layer count."""
    occupied, first, count = np.unique(flat, return_index=True, return_counts=True)
    if np.any((flat[1:] == flat[:-1]) & (medium[1:] == medium[:-1])):
        raise InputError("render: a grid has two bricks at the same place.")
    if count.max() > MAX_LAYERS:
        raise InputError(
            f"render: {count.max()} media meet in one brick; the renderer superposes {MAX_LAYERS}."
        )
    mask = np.zeros(shape, bool)
    mask.reshape(-1)[occupied] = True
    cells = (EMPTY_CELL | empty_radius(mask)).astype(np.uint32)
    cells.reshape(-1)[occupied] = ((count - 1) << 28 | first).astype(np.uint32)
    return cells, int(count.max())


def empty_radius(occupied: np.ndarray) -> np.ndarray:
    """Chebyshev distance to the nearest occupied cell, less one; cells outside count as empty."""
    if occupied.size * max(occupied.shape) > SMALL_GRID and occupied.any():
        from scipy.ndimage import distance_transform_cdt

        distance = distance_transform_cdt(~occupied, metric="chessboard")
        return np.clip(distance - 1, 0, 0xFFFF).astype(np.uint32)
    return _radius_by_growing(occupied)


def _radius_by_growing(occupied: np.ndarray) -> np.ndarray:
    """As `empty_radius`, without the quarter of a second that starting scipy takes."""
    radius = np.zeros(occupied.shape, np.uint32)
    reached = occupied.copy()
    while occupied.any():
        for axis in range(occupied.ndim):
            lines = np.moveaxis(reached, axis, 0)
            before = lines.copy()
            lines[1:] |= before[:-1]
            lines[:-1] |= before[1:]
        if reached.all():
            break
        radius += ~reached
    return radius


def _quantize(grids: Sequence[FiberGrid], order: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Voxel words, density step and largest level of every brick, in pool order."""
    target = np.empty(len(order), np.int64)
    target[order] = np.arange(len(order))
    colored = any(grid.albedo is not None for grid in grids)
    voxels = np.full((len(order), BRICK_VOXELS * (1 + colored)), WHITE, np.uint32)
    step = np.empty(len(order), np.float32)
    level = np.empty(len(order), np.uint32)
    start = 0
    for grid in grids:
        for begin in range(0, len(grid.origins), BRICKS_PER_CHUNK):
            chunk = slice(begin, begin + BRICKS_PER_CHUNK)
            place = target[start + begin : start + min(begin + BRICKS_PER_CHUNK, len(grid.origins))]
            words, step[place], level[place] = _quantize_chunk(grid.density[chunk], grid.direction[chunk])
            voxels[place, :BRICK_VOXELS] = words
            if grid.albedo is not None:
                voxels[place, BRICK_VOXELS:] = color_words(grid.albedo[chunk])
        start += len(grid.origins)
    return voxels, step, level


def quantize_bricks(
    grids: Sequence[FiberGrid], rows: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Voxel words, density steps and largest levels of some bricks, counted through the grids in order."""
    starts = np.cumsum([0, *(grid.brick_count for grid in grids)])
    colored = any(grid.albedo is not None for grid in grids)
    words = np.full((len(rows), BRICK_VOXELS * (1 + colored)), WHITE, np.uint32)
    step, level = np.empty(len(rows), np.float32), np.empty(len(rows), np.uint32)
    for grid, start, stop in zip(grids, starts, starts[1:], strict=False):
        mine = np.flatnonzero((rows >= start) & (rows < stop))
        if len(mine):
            own = rows[mine] - start
            voxels, step[mine], level[mine] = _quantize_chunk(grid.density[own], grid.direction[own])
            words[mine, :BRICK_VOXELS] = voxels
            if grid.albedo is not None:
                words[mine, BRICK_VOXELS:] = color_words(grid.albedo[own])
    return words, step, level


def _quantize_chunk(density: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Voxel words, density steps and largest levels of some bricks."""
    words, step, level = density_words(density)
    add_directions(words, direction)
    return words, step, level


def density_words(density: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Voxel words that lack directions, density steps and largest levels of some bricks."""
    peak = density.max(axis=1, keepdims=True)
    # divided first: levels over a tiny peak could overflow
    levels = np.rint(density / np.where(peak > 0, peak, 1) * DENSITY_LEVELS).astype(np.uint32)
    # keep the brick's fiber volume: the step comes from the sums, not from the peak
    step = density.sum(axis=1, dtype=np.float64) / np.maximum(levels.sum(axis=1), 1)
    occupied = levels > 0
    words = _empty_radius_in_brick(occupied).astype(np.uint32)
    words[occupied] = levels[occupied] << (2 * DIRECTION_BITS)
    return words, step.astype(np.float32), levels.max(axis=1)


def add_directions(words: np.ndarray, direction: np.ndarray) -> None:
    """Into words with fiber: axes, float32, shape [bricks, 512, 3]."""
    occupied = words >> (2 * DIRECTION_BITS) > 0
    words[occupied] |= encode_axis(direction[occupied])


def _empty_radius_in_brick(occupied: np.ndarray) -> np.ndarray:
    """Chebyshev distance to the nearest occupied voxel of the same brick, less one, shape [bricks, 512]."""
    near = occupied.reshape(-1, BRICK_SIZE, BRICK_SIZE, BRICK_SIZE)
    radius = np.zeros(near.shape, np.uint8)
    for _ in range(MAX_EMPTY_RADIUS_IN_BRICK):
        near = _dilate(near)
        if near.all():
            break
        radius += ~near
    return radius.reshape(len(radius), -1)


def _dilate(mask: np.ndarray) -> np.ndarray:
    """The mask and its 26 neighbors, within each brick."""
    for axis in (1, 2, 3):
        grown = mask.copy()
        low, high = [slice(None)] * 4, [slice(None)] * 4
        low[axis], high[axis] = slice(None, -1), slice(1, None)
        grown[tuple(high)] |= mask[tuple(low)]
        grown[tuple(low)] |= mask[tuple(high)]
        mask = grown
    return mask
