"""Paths that are on no lane: their state as the shaders store it, and the brick that they wait for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .passes import MODE_PARKED

ANY_CELL = -1
"""Of a path that waits for no brick, only for a lane."""
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


def no_paths(words: int, layers: int) -> Paths:
    """None of them."""
    rows = np.zeros((0, words, 4), np.uint32)
    return Paths(rows, np.zeros((0, layers * 4), np.float32), np.zeros(0, np.int64))


def join_paths(one: Paths, other: Paths) -> Paths:
    """Both."""
    return Paths(
        np.concatenate([one.rows, other.rows]),
        np.concatenate([one.film, other.film]),
        np.concatenate([one.cells, other.cells]),
    )
