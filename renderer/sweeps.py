"""The order in which bricks are loaded for paths that wait: sweeps over the screen, as an elevator goes.

A sweep goes through the cells in the order of swaths of the screen, up one and down the next, and loads a
brick at most once, and only where a path wants it, a few at a time. What it loaded stays until the pool is
full of it, so the fewer bricks are wanted, the wider is the part of the screen to which paths can go back. A
path that needs what has left waits for the next sweep, whose swaths are shifted by half of their width: what
was a border is now the middle.
"""

from __future__ import annotations

import math

import numpy as np

from .batches import Footprints

WINDOW_SHARE = 0.9
"""Of the pool, for what a sweep loaded last; the rest is for bricks that were wanted before."""
STEP_SHARE = 0.05
"""Of the pool, loaded at once: few, so that paths can still want what lies beside it."""
ASPECT = 1.8
"""Width of a swath over the height of the window in it. Fewer swaths have fewer borders; higher windows let
paths go back further."""
STEPS_PER_SWATH = 16
"""Of a window as large as the pool across its own width, as far as the order of cells tells them apart."""


def swath_count(columns: range, rows: range, bricks: int, capacity: int) -> int:
    """Into how many swaths to cut a part of the screen that sees so many bricks."""
    window = len(columns) * len(rows) * min(capacity / max(bricks, 1), 1.0)
    wished = round(len(columns) / max(math.sqrt(ASPECT * window), 1.0))
    return min(max(wished, 1), len(columns))


class Sweeps:
    """How far a sweep is; it only ever goes on."""

    def __init__(
        self,
        columns: range,
        rows: range,
        footprints: Footprints,
        layers: np.ndarray,
        capacity: int,
        swaths: int,
    ) -> None:
        middle = (footprints.low.astype(np.int64) + footprints.high) / 2
        self._across = np.clip((middle[:, 0] - columns.start) / len(columns), 0, 1) * swaths
        self._down = np.clip((middle[:, 1] - rows.start) / len(rows), 0, 1)
        steps = STEPS_PER_SWATH * swaths * len(rows) / len(columns)
        self._step = 1 / max(round(steps), 1)
        self._layers, self._span, self._at_once = layers, capacity * WINDOW_SHARE, capacity * STEP_SHARE
        self.number, self._place, self._loaded = -1, 0, np.zeros(0, np.int64)
        self._turn()

    def next_cells(self, wanted: np.ndarray) -> np.ndarray:
        """The next of the cells `wanted` (each once) that the sweep comes by. ValueError where none is."""
        if not len(wanted):
            raise ValueError("A sweep is for cells that paths want.")
        while not (ahead := self._rank[wanted] >= self._place).any():
            self._turn()
        cells = wanted[ahead][np.argsort(self._rank[wanted[ahead]], kind="stable")]
        counts = self._layers[cells]
        cells = cells[np.cumsum(counts) <= max(self._at_once, counts[0])]
        self._go_on(cells)
        return cells

    def _go_on(self, cells: np.ndarray) -> None:
        """Past what leaves the pool when these are loaded."""
        loaded = np.concatenate([self._loaded, cells])
        left = np.cumsum(self._layers[loaded][::-1])[::-1] > self._span
        self._place = max(self._place, int(self._rank[loaded[left]].max(initial=-1)) + 1)
        self._loaded = loaded[~left]

    def _turn(self) -> None:
        """Begin the next sweep."""
        self.number += 1
        swath = np.floor(self._across + 0.5 * (self.number % 2 == 0)).astype(np.int64)
        down = np.where(swath % 2 == self.number // 2 % 2, self._down, 1 - self._down)
        order = np.lexsort((np.floor(down / self._step), swath))
        self._rank = np.empty(len(order), np.int64)
        self._rank[order] = np.arange(len(order))
        self._place, self._loaded = 0, np.zeros(0, np.int64)
