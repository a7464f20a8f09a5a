"""Paths that are on no lane: their state as the shaders store it, and the brick that they wait for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .passes import MODE_PARKED

ANY_CELL, NO_PATH = -1, -2
"""Of a path that waits for no brick, only for a lane; of a place where no path is."""
FIRST_ROOM = 1 << 12
"""For paths that wait."""
MODE_BITS = MODE_PARKED - 1
SLOT_SHIFT = 4
"""Above these bits of a path's mode lies where its film is (shaders/path/state.glsl)."""


@dataclass(frozen=True)
class Paths:
    """Some paths with what their samples have added to the film so far."""

    rows: np.ndarray
    """uint32, shape [n, words, 4]; see shaders/path/state.glsl."""
    film: np.ndarray
    """float32, shape [n, layer_count * 4]."""
    cells: np.ndarray
    """The occupied cell whose bricks the path needs next, or `ANY_CELL`, int64, shape [n]."""

    def __len__(self) -> int:
        return len(self.cells)

    def part(self, chosen: np.ndarray) -> Paths:
        """Some of them."""
        return Paths(self.rows[chosen], self.film[chosen], self.cells[chosen])

    @property
    def pixels(self) -> np.ndarray:
        """Of the whole image, int64, shape [n]."""
        return self.rows[:, 8, 0].astype(np.int64)

    @property
    def samples(self) -> np.ndarray:
        """int64, shape [n]."""
        return self.rows[:, 8, 1].astype(np.int64)


class WaitingPaths:
    """Paths set aside. Which of them can go on changes with what is loaded only."""

    def __init__(self, words: int, layers: int) -> None:
        self._all = Paths(
            np.zeros((FIRST_ROOM, words, 4), np.uint32),
            np.zeros((FIRST_ROOM, layers * 4), np.float32),
            np.full(FIRST_ROOM, NO_PATH),
        )
        self._free = np.arange(FIRST_ROOM)
        self._ready = np.zeros(0, np.int64)

    def __len__(self) -> int:
        return len(self._all) - len(self._free)

    @property
    def ready_count(self) -> int:
        """Those that can go on."""
        return len(self._ready)

    def add(self, paths: Paths, can_go_on: np.ndarray) -> None:
        """More of them; `can_go_on`: bool, shape [n]."""
        while len(self._free) < len(paths):
            self._grow()
        places, self._free = self._free[: len(paths)], self._free[len(paths) :]
        for mine, theirs in zip(self._arrays(), (paths.rows, paths.film, paths.cells), strict=True):
            mine[places] = theirs
        self._ready = np.concatenate([self._ready, places[can_go_on]])

    def wanted(self, least: int = 1) -> np.ndarray:
        """The cells that at least so many paths wait for, or could go on in, each once."""
        cells, counts = np.unique(self._all.cells[self._all.cells >= 0], return_counts=True)
        return cells[counts >= least]

    def look_again(self, resident: np.ndarray) -> None:
        """After bricks were loaded. `resident`: whether each cell is there, bool, shape [cell_count]."""
        cells = self._all.cells
        self._ready = np.flatnonzero((cells == ANY_CELL) | ((cells >= 0) & resident[cells]))

    def take(self, count: int) -> Paths:
        """At most so many that can go on; they are no longer here."""
        places, self._ready = self._ready[:count], self._ready[count:]
        taken = self._all.part(places)
        self._all.cells[places] = NO_PATH
        self._free = np.concatenate([self._free, places])
        return taken

    def all(self) -> Paths:
        """All of them, which stay."""
        return self._all.part(np.flatnonzero(self._all.cells != NO_PATH))

    def _arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return self._all.rows, self._all.film, self._all.cells

    def _grow(self) -> None:
        """Twice the room."""
        room = len(self._all)
        rows, film, cells = (np.concatenate([array, np.zeros_like(array)]) for array in self._arrays())
        cells[room:] = NO_PATH
        self._all = Paths(rows, film, cells)
        self._free = np.concatenate([self._free, np.arange(room, 2 * room)])


def join_paths(one: Paths, other: Paths) -> Paths:
    """Both."""
    return Paths(
        np.concatenate([one.rows, other.rows]),
        np.concatenate([one.film, other.film]),
        np.concatenate([one.cells, other.cells]),
    )
