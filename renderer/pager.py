"""Bricks on the device: pages of voxels in slots, the table that finds them, uploads for paths that wait."""

from __future__ import annotations

from collections.abc import Iterator

import moderngl
import numpy as np

from .batches import Footprints, OccupiedCells, RenderBatch, cell_footprints, occupied_cells, subdivide_screen
from .gpu import buffers
from .residency import NO_BRICK, NOT_RESIDENT, Residency
from .scene import Scene

BRICK_BYTES = 2048
BATCH_SHARE = 0.75
"""Of the pool, for the bricks in a batch's frustum; the rest serves the paths that leave it."""
BRICKS_PER_UPLOAD = 1 << 14


def pool_capacity(scene: Scene) -> int | None:
    """Bricks in the device's pool; None where all of them are to be there."""
    limit = scene.config.brick_pool_mb
    if limit is None or limit * buffers.MIB >= len(scene.pool.voxels) * BRICK_BYTES:
        return None
    return int(limit * buffers.MIB) // BRICK_BYTES


class BrickPager:
    """The pool of one scene. `pages` and `bricks` are the kernel's buffers."""

    def __init__(
        self, context: moderngl.Context, scene: Scene, capacity: int, records: np.ndarray, page_bricks: int
    ) -> None:
        self._scene = scene
        self._cells: OccupiedCells = occupied_cells(scene.pool.cells)
        self._footprints: Footprints | None = None
        self._residency = Residency(self._cells.first, self._cells.layers, capacity)
        self._page_bricks = page_bricks
        self.pages = [
            buffers.reserve(context, min(page_bricks, capacity - start) * BRICK_BYTES, name="the brick pool")
            for start in range(0, capacity, page_bricks)
        ]
        self._table_offset = records.nbytes
        table = np.full(len(records) + len(records) % 2, NOT_RESIDENT, np.uint32)
        self.bricks = buffers.upload(
            context, np.concatenate([records.reshape(-1), table]), name="the bricks and their slots"
        )

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

    def batches(self, columns: range, rows: range) -> list[RenderBatch]:
        """Parts of a rectangle of pixels that fit the pool."""
        if self._footprints is None:
            margin = getattr(self._scene.config.filter, "radius_px", 0.0)
            self._footprints = cell_footprints(self._cells.places, self._scene.uniforms(), margin)
        capacity = int(self._residency.capacity * BATCH_SHARE)
        return subdivide_screen(columns, rows, self._footprints, self._cells.layers, capacity)

    def begin(self, batch: RenderBatch) -> None:
        """Load what the batch sees."""
        self._load(*self._residency.begin_batch(batch.cells))

    def serve(self, wanted: np.ndarray) -> None:
        """Load what paths wait for. `wanted`: the word of each lane, `NO_BRICK` where it does not wait."""
        self._load(*self._residency.serve(wanted[wanted != NO_BRICK].astype(np.int64)))

    def _load(self, bricks: np.ndarray, slots: np.ndarray) -> None:
        if not len(bricks):
            return
        for part in _runs(slots, self._page_bricks):
            page, place = divmod(int(slots[part.start]), self._page_bricks)
            voxels = self._scene.pool.voxels[bricks[part]]
            self.pages[page].write(np.ascontiguousarray(voxels), offset=place * BRICK_BYTES)
        self.bricks.write(self._residency.slot_of_brick, offset=self._table_offset)

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
