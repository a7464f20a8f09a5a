"""A volume at several voxel sizes, as voxelize.levels writes them, and pools of bricks of several levels."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

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
    LevelShare,
    build_brick_pool,
    check_values,
    empty_radius,
    quantize_bricks,
    refuse_too_many_cells,
)
from .detail import PixelFootprint, choose_bricks
from .direction_encoding import DIRECTION_BITS

Quantized = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Words, density steps and largest levels of some bricks (brick_pool.py)."""


@dataclass(frozen=True)
class VolumeLevels:
    """One volume, finest first, each with voxels twice as large as the one before."""

    levels: tuple[FiberVolume | BrickFile, ...]
    extinction_error_rms: tuple[float | None, ...] = ()
    """Of each level against the finest, relative, as voxelize measured it."""

    def __post_init__(self) -> None:
        size = voxel_size_mm(self.levels[0])
        for number, level in enumerate(self.levels):
            if not np.isclose(voxel_size_mm(level), size * 2**number, rtol=1e-9):
                raise InputError(
                    f"render: level {number} has voxels of {voxel_size_mm(level):g} mm; "
                    f"{size * 2**number:g} mm are right."
                )

    @property
    def media(self) -> tuple[str, ...]:
        """Of all levels; coarser ones may have second lobes of them besides."""
        return tuple(dict.fromkeys(name for level in self.levels for name in level.media))

    @property
    def bounds_mm(self) -> np.ndarray:
        """Corners of the box around the finest bricks [mm], float64, shape [2, 3]."""
        return np.asarray(self.levels[0].bounds_mm)

    @property
    def content_sha256(self) -> str:
        hashes = "\n".join(level.content_sha256 for level in self.levels)
        return hashlib.sha256(hashes.encode()).hexdigest()

    def pool(self, footprint: PixelFootprint, pixels: float) -> BrickPool:
        """Every brick at the coarsest level whose voxels appear no larger than `pixels`.

        Where all are of the finest level this is `build_brick_pool` of it.
        """
        size = voxel_size_mm(self.levels[0])
        bricks = [level_bricks(level, self.media) for level in self.levels]
        chosen = choose_bricks([b.places for b in bricks], size, footprint, pixels)
        if not any(rows.any() for rows in chosen[1:]):
            return replace(finest_pool(self.levels[0]), detail=(self._share(0, size, chosen[0], 1.0),))
        coarsest = max(number for number, rows in enumerate(chosen) if rows.any())
        pool, volumes = _mixed_pool(bricks[: coarsest + 1], chosen, size)
        shares = volumes / max(volumes.sum(), 1e-300)
        found = zip(range(coarsest + 1), chosen, shares.tolist(), strict=False)
        return replace(pool, detail=tuple(self._share(n, size, rows, share) for n, rows, share in found))

    def _share(self, number: int, size: float, chosen: np.ndarray, share: float) -> LevelShare:
        errors = self.extinction_error_rms
        error = 0.0 if number == 0 else errors[number] if number < len(errors) else None
        return LevelShare(number, size * 2**number, int(chosen.sum()), share, error)


def voxel_size_mm(volume: FiberVolume | BrickFile) -> float:
    """Edge of a voxel."""
    if isinstance(volume, BrickFile):
        return float(volume.header["voxel_size_mm"])
    return volume.voxel_size_mm


def finest_pool(volume: FiberVolume | BrickFile) -> BrickPool:
    """The bricks of one level alone."""
    return volume.pool() if isinstance(volume, BrickFile) else build_brick_pool(list(volume.grids.values()))


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


def level_bricks(volume: FiberVolume | BrickFile, media: Sequence[str]) -> LevelBricks:
    """`media`: the names whose places are the indices of media."""
    numbers = [media.index(name) for name in volume.media]
    if isinstance(volume, BrickFile):
        columns, words = volume.columns, volume.brick_words
        rows = RowsOnDisk(volume.path, np.arange(volume.brick_count), words)
        counts = volume.header["brick_counts"]
        radii, places = volume.header["fiber_radius_mm"], columns["origins"]

        def read(wanted: np.ndarray) -> Quantized:
            return rows[wanted], columns["density_step"][wanted], columns["majorant_level"][wanted]
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
    return LevelBricks(places.astype(np.int64) // BRICK_SIZE, medium, read, radius, words)


def _mixed_pool(
    levels: Sequence[LevelBricks], chosen: Sequence[np.ndarray], size: float
) -> tuple[BrickPool, np.ndarray]:
    """The pool of the chosen bricks, and the fiber volume in those of each level, in finest voxels."""
    rows = [np.flatnonzero(keep) for keep in chosen[: len(levels)]]
    if len({source.words for source in levels}) > 1:
        raise InputError(
            "render.detail_pixels: the volume has colors, its coarser levels have none.",
            hint="Leave out detail_pixels, or voxelize.albedo.",
        )
    level = np.repeat(np.arange(len(levels)), [len(r) for r in rows])
    medium = np.concatenate([b.medium[r] for b, r in zip(levels, rows, strict=True)])
    places = np.concatenate([b.places[r] << n for n, (b, r) in enumerate(zip(levels, rows, strict=True))])
    lattice = _Lattice.around(places, level, 1 << (len(levels) - 1))
    flat = np.ravel_multi_index(tuple((places - lattice.low).T), lattice.shape)
    order = np.lexsort((medium, flat))
    words, step, top = _read_all(levels, rows, np.argsort(order))
    level, flat = level[order], flat[order]
    voxels = words[:, :BRICK_VOXELS]
    cells, layer_count = lattice.link(flat, places[order], level, voxels)
    radius = {number: r for source in levels for number, r in source.fiber_radius_mm.items()}
    pool = BrickPool(
        voxel_size_mm=size,
        origin=lattice.low * BRICK_SIZE,
        cells=cells,
        voxels=words,
        density_step=step,
        majorant_level=top,
        medium=medium[order],
        fiber_radius_mm=np.array([radius[number] for number in sorted(radius)]),
        layer_count=layer_count,
        has_colors=levels[0].words > BRICK_VOXELS,
        coarsest_level=len(levels) - 1,
    )
    return pool, np.bincount(level, _level_sums(voxels) * step * 8.0**level, minlength=len(levels))


def _read_all(levels: Sequence[LevelBricks], rows: Sequence[np.ndarray], target: np.ndarray) -> Quantized:
    """The chosen `rows` of each level, in turn, each at its place in the pool."""
    words = np.empty((len(target), levels[0].words), np.uint32)
    step, top = np.empty(len(target), np.float32), np.empty(len(target), np.uint32)
    begin = 0
    for source, wanted in zip(levels, rows, strict=True):
        for start in range(0, len(wanted), BRICKS_PER_CHUNK):
            part = wanted[start : start + BRICKS_PER_CHUNK]
            here = target[begin + start : begin + start + len(part)]
            words[here], step[here], top[here] = source.read(part)
        begin += len(wanted)
    return words, step, top


def _level_sums(voxels: np.ndarray) -> np.ndarray:
    """Sum of the density levels of each brick, float64, from words of shape [n, 512]."""
    parts = [
        (voxels[start : start + BRICKS_PER_CHUNK] >> (2 * DIRECTION_BITS)).sum(axis=1, dtype=np.float64)
        for start in range(0, len(voxels), BRICKS_PER_CHUNK)
    ]
    return np.concatenate(parts)


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
        self, flat: np.ndarray, places: np.ndarray, level: np.ndarray, words: np.ndarray
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
            mine = np.flatnonzero(level == number)
            for start in range(0, len(mine), BRICKS_PER_CHUNK):
                part = mine[start : start + BRICKS_PER_CHUNK]
                brick, *within = np.nonzero(_cells_with_fiber(words[part], number))
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
