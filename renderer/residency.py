"""Which bricks lie in the device's pool: slots, and what has to leave. Bookkeeping only.

A path that waits names one brick, but a cell whose media overlap needs all of its bricks at once; so cells
are what is admitted.
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
    slot_of_brick: np.ndarray = field(init=False)
    brick_of_slot: np.ndarray = field(init=False)
    asked_at: np.ndarray = field(init=False)
    """Per slot, the number of the request that last wanted its brick; the least leaves first."""
    was_loaded: np.ndarray = field(init=False)
    cell_of_brick: np.ndarray = field(init=False)
    lacks: np.ndarray = field(init=False)
    """Per cell, how many of its bricks are not there, int64."""
    request: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        if self.capacity < self.layers.max():
            raise InputError(
                f"render: a pool of {self.capacity} bricks cannot hold the {self.layers.max()} of one cell.",
                hint="Raise render.brick_pool_mb.",
            )
        brick_count = int(self.layers.sum())
        self.slot_of_brick = np.full(brick_count, NOT_RESIDENT, np.uint32)
        self.brick_of_slot = np.full(self.capacity, -1, np.int64)
        self.asked_at = np.zeros(self.capacity, np.int64)
        self.was_loaded = np.zeros(brick_count, bool)
        self.cell_of_brick = np.repeat(np.arange(len(self.layers)), self.layers)
        self.lacks = self.layers.copy()

    def admit(self, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Bricks to load and their slots, ascending: the first of `cells`, as many as fit, are there then."""
        bricks = self.bricks_of(self.fitting(cells))
        self.request += 1
        there = self.slot_of_brick[bricks] != NOT_RESIDENT
        self.asked_at[self.slot_of_brick[bricks[there]]] = self.request
        missing = np.sort(bricks[~there])
        slots = np.sort(np.argsort(self.asked_at, kind="stable")[: len(missing)])
        gone = self.brick_of_slot[slots]
        gone = gone[gone >= 0]
        self.slot_of_brick[gone] = NOT_RESIDENT
        np.add.at(self.lacks, self.cell_of_brick[gone], 1)
        np.subtract.at(self.lacks, self.cell_of_brick[missing], 1)
        self.brick_of_slot[slots], self.asked_at[slots] = missing, self.request
        self.slot_of_brick[missing] = slots
        self.was_loaded[missing] = True
        self.uploads += len(missing)
        return missing, slots

    def fitting(self, cells: np.ndarray) -> np.ndarray:
        """The first of some cells, as many as fit at once."""
        return cells[np.cumsum(self.layers[cells]) <= self.capacity]

    def resident(self) -> np.ndarray:
        """Whether all bricks of each cell are there, bool, shape [cell_count]."""
        return self.lacks == 0

    def bricks_of(self, cells: np.ndarray) -> np.ndarray:
        """All bricks of some cells, cell by cell."""
        layers = self.layers[cells]
        within = np.arange(layers.sum()) - np.repeat(np.cumsum(layers) - layers, layers)
        return np.repeat(self.first[cells], layers) + within
