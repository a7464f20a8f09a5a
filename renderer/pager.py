"""Bricks on the device: pages of voxels in slots, the table that finds them, uploads for paths that wait."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import moderngl
import numpy as np

from .batches import (
    Footprints,
    OccupiedCells,
    RenderBatch,
    cell_footprints,
    occupied_cells,
    rim_of,
    screen_strips,
    seen_cells,
    subdivide_screen,
)
from .brick_pool import BRICK_VOXELS, BrickPool
from .direction_encoding import DIRECTION_BITS, encode_axis
from .gpu import buffers
from .residency import NO_BRICK, NOT_RESIDENT, Residency
from .scene import Scene
from .sweeps import Sweeps, swath_count
from .voxel_colors import color_words, colors_of_words
from .waiting import ANY_CELL

BATCH_SHARE = 0.75
"""Of the pool, for the bricks in the frustum of a batch that stands alone."""
BRICKS_PER_UPLOAD = 1 << 14
BRICKS_PER_SUM = 1 << 10


def pool_capacity(scene: Scene) -> int | None:
    """Bricks in the device's pool; None where all of them are to be there."""
    limit = scene.config.brick_pool_mb
    if limit is None or limit * buffers.MIB >= len(scene.pool.voxels) * 4 * scene.pool.brick_words:
        return None
    return int(limit * buffers.MIB) // (4 * scene.pool.brick_words)


@dataclass(frozen=True)
class MeanBricks:
    """One brick per medium that stands for all outside of a batch: mean density, axes in all directions."""

    voxels: np.ndarray
    """uint32, shape [medium_count, 512], or 1024 with colors, the mean one."""
    records: np.ndarray
    """As those of the bricks (kernel.py), uint32, shape [medium_count, 2]."""


def mean_bricks(pool: BrickPool, extinction_scale: np.ndarray) -> MeanBricks:
    """The thesis' homogeneous medium "with similar properties" as bricks (section 5.6.1)."""
    count = len(extinction_scale)
    total, bricks = np.zeros(count), np.bincount(pool.medium, minlength=count)
    for start in range(0, len(pool.voxels), BRICKS_PER_UPLOAD):
        part = slice(start, start + BRICKS_PER_UPLOAD)
        levels = pool.voxels[part][:, :BRICK_VOXELS] >> (2 * DIRECTION_BITS)
        sums = levels.sum(axis=1, dtype=np.float64) * pool.density_step[part]
        total += np.bincount(pool.medium[part], sums, minlength=count)
    density = total / np.maximum(bricks * BRICK_VOXELS, 1)
    if pool.has_colors:
        colors = np.repeat(color_words(mean_colors(pool, count))[:, None], BRICK_VOXELS, axis=1)
    else:
        colors = np.empty((count, 0), np.uint32)
    axes = np.random.default_rng(0).normal(size=(count * BRICK_VOXELS, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    voxels = encode_axis(axes).reshape(count, -1).astype(np.uint32) | np.uint32(1 << 2 * DIRECTION_BITS)
    records = np.stack(
        [(density * extinction_scale).astype(np.float32).view(np.uint32), np.arange(count)], -1
    )
    return MeanBricks(
        np.concatenate([voxels, colors], axis=1), (records + np.array([0, 1 << 16])).astype(np.uint32)
    )


def mean_colors(pool: BrickPool, medium_count: int) -> np.ndarray:
    """Linear RGB of the fiber of each medium, float64, shape [medium_count, 3]."""
    total, weight = np.zeros((medium_count, 3)), np.zeros(medium_count)
    for start in range(0, len(pool.voxels), BRICKS_PER_SUM):
        part = slice(start, start + BRICKS_PER_SUM)
        words, medium = pool.voxels[part], pool.medium[part]
        fiber = (words[:, :BRICK_VOXELS] >> (2 * DIRECTION_BITS)) * pool.density_step[part][:, None]
        colors = np.einsum("bv,bvc->bc", fiber, colors_of_words(words[:, BRICK_VOXELS:]))
        np.add.at(total, medium, colors)
        weight += np.bincount(medium, fiber.sum(axis=1), minlength=medium_count)
    return total / np.maximum(weight, 1e-30)[:, None]


class BrickPager:
    """The pool of one scene. `pages` and `bricks` are the kernel's buffers."""

    def __init__(
        self, context: moderngl.Context, scene: Scene, capacity: int, records: np.ndarray, page_bricks: int
    ) -> None:
        self._scene = scene
        self._cells: OccupiedCells = occupied_cells(scene.pool.cells, leveled=scene.pool.coarsest_level > 0)
        self._footprints: Footprints | None = None
        self._residency = Residency(self._cells.first, self._cells.layers, capacity)
        self._page_bricks = page_bricks
        self._brick_bytes = 4 * scene.pool.brick_words
        self._records = records
        self._stand_in = None
        if scene.config.outside_batch == "homogeneous":
            self._stand_in = mean_bricks(scene.pool, scene.extinction_scale)
            self._residency.capacity -= len(self._stand_in.records)
            self._inside = np.zeros(len(records), bool)
        self.pages = [
            buffers.reserve(
                context, min(page_bricks, capacity - start) * self._brick_bytes, name="the brick pool"
            )
            for start in range(0, capacity, page_bricks)
        ]
        self._table_offset = records.nbytes
        table = np.full(len(records) + len(records) % 2, NOT_RESIDENT, np.uint32)
        self.bricks = buffers.upload(
            context, np.concatenate([records.reshape(-1), table]), name="the bricks and their slots"
        )
        if self._stand_in is not None:
            for part in _runs(self._stand_in_slots(), page_bricks):
                self._write(self._stand_in.voxels[part], self._stand_in_slots()[part])

    def change(self, scene: Scene) -> None:
        """Another camera on the same volume."""
        self._scene, self._footprints = scene, None

    @property
    def uploads(self) -> int:
        """Bricks loaded so far."""
        return self._residency.uploads

    @property
    def bricks_used(self) -> int:
        """Different bricks among them."""
        return int(np.count_nonzero(self._residency.was_loaded))

    @property
    def capacity(self) -> int:
        """Bricks that have room."""
        return self._residency.capacity

    @property
    def exact(self) -> bool:
        """Whether paths wait for the true voxels."""
        return self._stand_in is None

    def plan(self, columns: range, rows: range) -> tuple[list[RenderBatch], Sweeps]:
        """Parts of a rectangle of pixels in the order in which to trace them, and how to go on after them."""
        if self._footprints is None:
            margin = getattr(self._scene.config.filter, "radius_px", 0.0)
            self._footprints = cell_footprints(
                self._cells.places, self._scene.uniforms(), margin, self._cells.sides
            )
        seen, layers = (columns, rows, self._footprints), self._cells.layers
        swaths = swath_count(columns, rows, int(layers[seen_cells(*seen)].sum()), self.capacity)
        sweeps = Sweeps(*seen, layers, self.capacity, swaths)
        if self._stand_in is not None:
            return subdivide_screen(*seen, layers, int(self.capacity * BATCH_SHARE)), sweeps
        return screen_strips(*seen, layers, self.capacity, swaths), sweeps

    def load(self, cells: np.ndarray) -> None:
        """The bricks of these cells, the first where not all fit. Beside a stand-in only they exist."""
        cells = self._residency.fitting(cells)
        self._load(*self._residency.admit(cells))
        if self._stand_in is not None:
            self._inside[:] = False
            self._inside[self._residency.bricks_of(cells)] = True
            self.bricks.write(
                np.where(
                    self._inside[:, None], self._records, self._stand_in.records[self._scene.pool.medium]
                )
            )
            self._write_table()

    def rim(self, strip: RenderBatch, wanted: np.ndarray) -> np.ndarray:
        """Cells to load along with a strip of the plan, of those that paths wait for."""
        assert self._footprints is not None
        return rim_of(strip, wanted, self._footprints)

    def cells_wanted(self, bricks: np.ndarray) -> np.ndarray:
        """The cell of each brick that a path waits for; `ANY_CELL` for those that wait for none."""
        cells = np.full(len(bricks), ANY_CELL, np.int64)
        waits = bricks != NO_BRICK
        cells[waits] = self._residency.cell_of_brick[bricks[waits]]
        return cells

    def resident(self) -> np.ndarray:
        """Whether all bricks of each cell are there, bool, shape [cell_count]."""
        return self._residency.resident()

    def _load(self, bricks: np.ndarray, slots: np.ndarray) -> None:
        if not len(bricks):
            return
        for part in _runs(slots, self._page_bricks):
            self._write(self._scene.pool.voxels[bricks[part]], slots[part])
        self._write_table()

    def _write(self, voxels: np.ndarray, slots: np.ndarray) -> None:
        """Into consecutive slots of one page."""
        page, place = divmod(int(slots[0]), self._page_bricks)
        self.pages[page].write(np.ascontiguousarray(voxels), offset=place * self._brick_bytes)

    def _write_table(self) -> None:
        table = self._residency.slot_of_brick
        if self._stand_in is not None:
            outside = self._stand_in_slots()[self._scene.pool.medium].astype(np.uint32)
            table = np.where(self._inside, table, outside)
        self.bricks.write(table, offset=self._table_offset)

    def _stand_in_slots(self) -> np.ndarray:
        """Those behind the pool's own, one per medium."""
        assert self._stand_in is not None
        return self._residency.capacity + np.arange(len(self._stand_in.records))

    def release(self) -> None:
        """Give the device memory back."""
        for buffer in (self.bricks, *self.pages):
            buffer.release()


def _runs(slots: np.ndarray, page_bricks: int) -> Iterator[slice]:
    """Parts of consecutive slots on one page, none too long."""
    breaks = np.flatnonzero((np.diff(slots) != 1) | (slots[1:] % page_bricks == 0)) + 1
    for start, stop in zip([0, *breaks.tolist()], [*breaks.tolist(), len(slots)], strict=True):
        for begin in range(start, stop, BRICKS_PER_UPLOAD):
            yield slice(begin, min(begin + BRICKS_PER_UPLOAD, stop))
