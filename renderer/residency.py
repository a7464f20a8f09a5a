"""Which bricks lie in the device's pool: slots, demand by waiting paths, eviction. Bookkeeping only.

A path that waits names one brick, but a cell whose media overlap needs all of its bricks at once; so cells
are what is admitted. What is admitted is never evicted in the same round, so every round in which paths wait
lets at least one of them go on.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from weft.files.errors import InputError

NOT_RESIDENT = 0xFFFFFFFF
NO_BRICK = NOT_RESIDENT


@dataclass
class Residency:
    """The places of `capacity` bricks out of `brick_count`; `first` and `layers`: those of a cell."""

    first: np.ndarray
    """First brick of each occupied cell, ascending, int64, shape [cell_count]."""
    layers: np.ndarray
    """Bricks of each occupied cell, int64, shape [cell_count]."""
    capacity: int
    uploads: int = 0
    hand: int = 0
    """The slot that is looked at first when room is needed: the one filled longest ago."""
    slot_of_brick: np.ndarray = field(init=False)
    brick_of_slot: np.ndarray = field(init=False)
    in_batch: np.ndarray = field(init=False)
    """Per brick, whether the batch at work sees it; such bricks leave last."""
    was_loaded: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        if self.capacity < self.layers.max():
            raise InputError(
                f"render: a pool of {self.capacity} bricks cannot hold the {self.layers.max()} of one cell.",
                hint="Raise render.brick_pool_mb.",
            )
        brick_count = int(self.layers.sum())
        self.slot_of_brick = np.full(brick_count, NOT_RESIDENT, np.uint32)
        self.brick_of_slot = np.full(self.capacity, -1, np.int64)
        self.in_batch = np.zeros(brick_count, bool)
        self.was_loaded = np.zeros(brick_count, bool)

    def begin_batch(self, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Bricks to load and their slots, before a batch that sees `cells` (nearest first) starts."""
        self.in_batch[:] = False
        self.in_batch[self._bricks(cells)] = True
        return self._admit(cells)

    def serve(self, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Bricks to load and their slots, for paths that wait for the bricks `wanted` (with repetitions).

        Cells come in the order of waiting paths per byte.
        """
        cells, waiting = np.unique(np.searchsorted(self.first, wanted, side="right") - 1, return_counts=True)
        return self._admit(cells[np.argsort(-waiting / self.layers[cells], kind="stable")])

    def _admit(self, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """As many of `cells`, in this order, as fit at once."""
        fitting = np.cumsum(self.layers[cells]) <= self.capacity
        bricks = self._bricks(cells[fitting])
        missing = bricks[self.slot_of_brick[bricks] == NOT_RESIDENT]
        slots = self._free_slots(len(missing), keep=bricks)
        gone = self.brick_of_slot[slots]
        self.slot_of_brick[gone[gone >= 0]] = NOT_RESIDENT
        self.brick_of_slot[slots] = missing
        self.slot_of_brick[missing] = slots
        self.was_loaded[missing] = True
        self.uploads += len(missing)
        return missing, slots

    def _free_slots(self, count: int, *, keep: np.ndarray) -> np.ndarray:
        """Slots to fill: empty ones, and those filled longest ago; bricks that the batch sees come last."""
        if count == 0:
            return np.empty(0, np.int64)
        order = np.roll(np.arange(self.capacity), -self.hand)
        held = self.brick_of_slot[order]
        kept = np.zeros(len(self.slot_of_brick), bool)
        kept[keep] = True
        free = (held < 0) | ~kept[held]
        late = (held >= 0) & self.in_batch[held]
        chosen = np.concatenate([order[free & ~late], order[free & late]])[:count]
        self.hand = int(chosen[-1] + 1) % self.capacity
        return chosen

    def _bricks(self, cells: np.ndarray) -> np.ndarray:
        """All bricks of some cells, cell by cell."""
        layers = self.layers[cells]
        within = np.arange(layers.sum()) - np.repeat(np.cumsum(layers) - layers, layers)
        return np.repeat(self.first[cells], layers) + within
