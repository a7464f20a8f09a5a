"""Pools of bricks of several levels of detail: cells at different places hold different voxels."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from weft.files.errors import DeviceMemoryError, InputError
from weft.voxelize.grid import BRICK_SIZE, BRICK_VOXELS, FiberVolume

from .brick_file import BrickFile, RowsOnDisk
from .brick_pool import (
    BRICKS_PER_CHUNK,
    EMPTY_CELL,
    LEVEL_SHIFT,
    MAX_LAYERS,
    BrickPool,
    VoxelRows,
    check_values,
    empty_radius,
    quantize_bricks,
    refuse_too_many_cells,
)
from .direction_encoding import DIRECTION_BITS

Quantized = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Words, density steps and largest levels of some bricks (brick_pool.py)."""


@dataclass(frozen=True)
class LevelBricks:
    """The bricks of one level, whose voxels are made or read when they are asked for."""

    places: np.ndarray
    """Origins over 8, int64, shape [n, 3]."""
    medium: np.ndarray
    """Among those of all levels, uint32, shape [n]."""
    read: Callable[[np.ndarray], Quantized]
    """Of some rows."""
    fiber_radius_mm: dict[int, float]
    """By medium."""
    words: int
    """Of one brick: 512, or 1024 with colors."""
    columns: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]] | None = None
    """Density steps and largest levels of some rows, where these are known without the voxels."""


def level_bricks(volume: FiberVolume | BrickFile, media: Sequence[str]) -> LevelBricks:
    """`media`: the names whose places are the indices of media."""
    numbers = [media.index(name) for name in volume.media]
    if isinstance(volume, BrickFile):
        columns, words = volume.columns, volume.brick_words
        rows = RowsOnDisk(volume.path, np.arange(volume.brick_count), words)
        counts = volume.header["brick_counts"]
        radii, places = volume.header["fiber_radius_mm"], columns["origins"]

        def known(wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            return columns["density_step"][wanted], columns["majorant_level"][wanted]

        def read(wanted: np.ndarray) -> Quantized:
            return rows[wanted], *known(wanted)
    else:
        grids = list(volume.grids.values())
        for index, grid in enumerate(grids):
            check_values(grid, index)
        counts, radii = [grid.brick_count for grid in grids], [grid.fiber_radius_mm for grid in grids]
        places = np.concatenate([grid.origins for grid in grids])
        words = BRICK_VOXELS * (1 + any(grid.albedo is not None for grid in grids))

        def read(wanted: np.ndarray) -> Quantized:
            return quantize_bricks(grids, wanted)

    medium = np.repeat(np.array(numbers, np.uint32), counts)
    radius = dict(zip(numbers, (float(r) for r in radii), strict=True))
    found = known if isinstance(volume, BrickFile) else None
    return LevelBricks(places.astype(np.int64) // BRICK_SIZE, medium, read, radius, words, found)


class RowsOfLevels:
    """The voxel words of bricks of several levels, read when they are asked for."""

    def __init__(self, levels: Sequence[LevelBricks], level: np.ndarray, row: np.ndarray) -> None:
        self._levels, self._level, self._row = levels, level, row

    def __len__(self) -> int:
        return len(self._row)

    def __getitem__(self, bricks: Any) -> np.ndarray:
        """Of a slice or an array of bricks, uint32, shape [n, 512 or 1024]."""
        return self.read(bricks)[0]

    def read(self, bricks: Any) -> Quantized:
        """With what is known of them."""
        level, row = self._level[bricks], self._row[bricks]
        words = np.empty((len(row), self._levels[0].words), np.uint32)
        step, top = np.empty(len(row), np.float32), np.empty(len(row), np.uint32)
        for number in np.unique(level).tolist():
            mine = np.flatnonzero(level == number)
            words[mine], step[mine], top[mine] = self._levels[number].read(row[mine])
        return words, step, top

    def columns(self) -> tuple[np.ndarray, np.ndarray]:
        """Density steps and largest levels, of bricks whose voxels stay on the disk."""
        step, top = np.empty(len(self), np.float32), np.empty(len(self), np.uint32)
        for number, source in enumerate(self._levels):
            mine = self._level == number
            assert source.columns is not None
            step[mine], top[mine] = source.columns(self._row[mine])
        return step, top

    def held(self) -> Quantized:
        """All of them, in memory."""
        count = len(self)
        words = np.empty((count, self._levels[0].words), np.uint32)
        step, top = np.empty(count, np.float32), np.empty(count, np.uint32)
        for part in _chunks(np.arange(count)):
            words[part], step[part], top[part] = self.read(part)
        return words, step, top


def mixed_pool(
    levels: Sequence[LevelBricks], chosen: Sequence[np.ndarray], size: float, *, on_disk: bool
) -> tuple[BrickPool, np.ndarray]:
    """The pool of the chosen bricks, and the share of the fiber in those of each level.

    `on_disk`: voxels stay there, where they are on the disk; those of coarse levels are looked at once.
    """
    if len({source.words for source in levels}) > 1:
        raise InputError(
            "render.detail_pixels: only some of the volume's levels have colors.",
            hint="Make the volume and its levels again.",
        )
    rows = [np.flatnonzero(keep) for keep in chosen[: len(levels)]]
    level = np.repeat(np.arange(len(levels)), [len(r) for r in rows])
    medium = np.concatenate([b.medium[r] for b, r in zip(levels, rows, strict=True)])
    places = np.concatenate([b.places[r] << n for n, (b, r) in enumerate(zip(levels, rows, strict=True))])
    lattice = _Lattice.around(places, level, 1 << (len(levels) - 1))
    flat = np.ravel_multi_index(tuple((places - lattice.low).T), lattice.shape)
    order = np.lexsort((medium, flat))
    level, flat = level[order], flat[order]
    source = RowsOfLevels(levels, level, np.concatenate(rows)[order])
    voxels: VoxelRows = source
    if on_disk and all(one.columns is not None for one in levels):
        step, top = source.columns()
    else:
        voxels, step, top = source.held()
    cells, layer_count = lattice.link(flat, places[order], level, voxels)
    radius = {number: r for one in levels for number, r in one.fiber_radius_mm.items()}
    pool = BrickPool(
        voxel_size_mm=size,
        origin=lattice.low * BRICK_SIZE,
        cells=cells,
        voxels=voxels,
        density_step=step,
        majorant_level=top,
        medium=medium[order],
        fiber_radius_mm=np.array([radius[number] for number in sorted(radius)]),
        layer_count=layer_count,
        has_colors=levels[0].words > BRICK_VOXELS,
        coarsest_level=len(levels) - 1,
    )
    return pool, _fiber_shares(levels[-1], voxels, level, step)


def _fiber_shares(
    coarsest: LevelBricks, voxels: VoxelRows, level: np.ndarray, step: np.ndarray
) -> np.ndarray:
    """Of each level, shape [level_count]; all levels hold the same fiber, so the finest has what is left."""
    last = int(level.max())
    every = np.arange(len(coarsest.places))
    total = (
        sum(float(_level_sums(words) @ steps) for words, steps, _ in map(coarsest.read, _chunks(every)))
        * 8.0**last
    )
    shares = np.zeros(last + 1)
    for number in range(1, last + 1):
        for part in _chunks(np.flatnonzero(level == number)):
            shares[number] += _level_sums(voxels[part]) @ step[part] * 8.0**number / max(total, 1e-300)
    shares[0] = max(1 - shares.sum(), 0.0) if (level == 0).any() else 0.0
    return shares


def _level_sums(words: np.ndarray) -> np.ndarray:
    """Sum of the density levels of each brick, float64, shape [n]."""
    return (words[:, :BRICK_VOXELS] >> (2 * DIRECTION_BITS)).sum(axis=1, dtype=np.float64)


def _chunks(rows: np.ndarray) -> Iterator[np.ndarray]:
    yield from (rows[start : start + BRICKS_PER_CHUNK] for start in range(0, len(rows), BRICKS_PER_CHUNK))


@dataclass(frozen=True)
class _Lattice:
    """Cells around bricks of several levels, whole bricks of the coarsest along every edge."""

    low: np.ndarray
    shape: tuple[int, ...]

    @classmethod
    def around(cls, places: np.ndarray, level: np.ndarray, coarsest: int) -> _Lattice:
        """`places`: first cells of bricks; `coarsest`: cells along the edge of the largest."""
        low = places.min(axis=0) // coarsest * coarsest
        high = -(-(places + (1 << level)[:, None]).max(axis=0) // coarsest) * coarsest
        shape = tuple(int(n) for n in high - low)
        refuse_too_many_cells(shape)
        if len(places) > 1 << LEVEL_SHIFT:
            raise DeviceMemoryError(
                f"render: {len(places)} bricks are more than detail_pixels can hold, {1 << LEVEL_SHIFT}.",
                hint="Raise render.detail_pixels.",
            )
        return cls(low, shape)

    def link(
        self, flat: np.ndarray, places: np.ndarray, level: np.ndarray, voxels: VoxelRows
    ) -> tuple[np.ndarray, int]:
        """Words of all cells, and the largest number of layers; bricks at one place follow each other."""
        _, first, place, count = np.unique(flat, return_index=True, return_inverse=True, return_counts=True)
        if count.max() > MAX_LAYERS:
            raise InputError(
                f"render: {count.max()} media meet in one brick; the renderer superposes {MAX_LAYERS}."
            )
        word = (count - 1) << 28 | np.asarray(level)[first] << LEVEL_SHIFT | first
        cells = np.full(self.shape, EMPTY_CELL, np.uint32)
        for number in np.unique(level).tolist():
            for part in _chunks(np.flatnonzero(level == number)):
                if number == 0:
                    cells[tuple((places[part] - self.low).T)] = word[place[part]]
                    continue
                brick, *within = np.nonzero(_cells_with_fiber(voxels[part][:, :BRICK_VOXELS], number))
                cell = places[part][brick] - self.low + np.stack(within, axis=-1)
                cells[tuple(cell.T)] = word[place[part]][brick]
        empty = cells == EMPTY_CELL
        cells |= np.where(empty, empty_radius(~empty), 0).astype(np.uint32)
        return cells, int(count.max())


def _cells_with_fiber(words: np.ndarray, level: int) -> np.ndarray:
    """Which of the cells that a brick covers hold fiber, bool, [n, s, s, s], s = 2^level; at least one."""
    held = (words >> (2 * DIRECTION_BITS) > 0).reshape(-1, BRICK_SIZE, BRICK_SIZE, BRICK_SIZE)
    held[~held.any(axis=(1, 2, 3)), 0, 0, 0] = True
    side = 1 << level
    if side > BRICK_SIZE:
        for axis in (1, 2, 3):
            held = np.repeat(held, side // BRICK_SIZE, axis=axis)
        return held
    n = BRICK_SIZE // side
    return np.any(held.reshape(-1, side, n, side, n, side, n), axis=(2, 4, 6))
