"""The order in which bricks are loaded for paths that wait: sweeps over the screen, as an elevator goes.

A window as large as the pool slides through the cells in the order of swaths of the screen, up one and down
the next; a sweep loads a brick at most once, and only where a path wants it. A path that needs what lies
behind the window waits for the next sweep, whose swaths are shifted by half of their width: what was a border
is now the middle.
"""

from __future__ import annotations

import math

import numpy as np

from .batches import Footprints

WINDOW_SHARE = 0.9
"""Of the pool, for the window; the rest is for bricks that were wanted before."""
ASPECT = 3.0
"""Width of a swath over the height of the window in it. Fewer swaths have fewer borders; higher windows let
paths go back further."""
STEPS_PER_SWATH = 16
"""Of the window across its own width, as far as the order of cells tells them apart."""


def swath_count(columns: range, rows: range, bricks: int, capacity: int) -> int:
    """Into how many swaths to cut a part of the screen that sees so many bricks."""
    window = len(columns) * len(rows) * min(capacity / max(bricks, 1), 1.0)
    wished = round(len(columns) / max(math.sqrt(ASPECT * window), 1.0))
    return min(max(wished, 1), len(columns))


class Sweeps:
    """Where the window is; it only ever goes on."""

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
        self._layers, self._span = layers, capacity * WINDOW_SHARE
        self.number, self._place = -1, 0
        self._turn()

    def next_cells(self, wanted: np.ndarray) -> np.ndarray:
        """Those of the cells `wanted` (one at least, each once) in the window, which moves on if it must."""
        while True:
            rank = self._rank[wanted]
            ahead = rank >= self._place
            if not ahead.any():
                self._turn()
                continue
            limit = self._before[self._place] + self._span
            inside = ahead & ((self._before[rank] < limit) | (rank == self._place))
            if inside.any():
                return wanted[inside][np.argsort(rank[inside], kind="stable")]
            self._place = int(rank[ahead].min())

    def _turn(self) -> None:
        """Begin the next sweep."""
        self.number += 1
        swath = np.floor(self._across + 0.5 * (self.number % 2 == 0)).astype(np.int64)
        down = np.where(swath % 2 == self.number // 2 % 2, self._down, 1 - self._down)
        order = np.lexsort((np.floor(down / self._step), swath))
        self._rank = np.empty(len(order), np.int64)
        self._rank[order] = np.arange(len(order))
        counts = self._layers[order]
        self._before = np.cumsum(counts) - counts
        self._place = 0
