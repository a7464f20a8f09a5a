"""A pass: samples of a part of the picture taken together, and its state between dispatches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Window = tuple[int, int, int, int]
"""Left, top, width and height [pixels]."""
MODE_IDLE, MODE_DONE, MODE_PARKED = 4, 5, 8
"""Of shaders/path/state.glsl."""
NO_PIXEL = 0xFFFFFFFF
ROWS_PER_STRIP = 16
"""Of nth_pixel in shaders/path/trace.comp."""


@dataclass(frozen=True)
class Pass:
    """Some samples of each pixel of a part of the picture, done together."""

    window: Window
    samples: range

    @property
    def pixel_count(self) -> int:
        return self.window[2] * self.window[3]

    def blocks(self, block_samples: int) -> range:
        """The blocks that its samples lie in."""
        return range(self.samples.start // block_samples, -(-self.samples.stop // block_samples))


@dataclass(frozen=True)
class Aside:
    """Of a pass out of core: where it is, and samples that are not in the sums yet."""

    capacity: int
    """Of the pool [bricks]; the strips of the screen depend on it."""
    strip: int
    first_sample: int
    """Of the part of the strip's samples that is under way."""
    last_sample: int
    """The one behind them; -1: nobody knows yet."""
    film: np.ndarray
    """What the path of each lane has added, float32, shape [lane_count, layer_count * 4]."""
    next: np.ndarray
    """The sample that each block of each pixel takes next, int64, shape [block_count * pixel_count]."""
    loose: np.ndarray
    """Finished samples that come later: pixel within the pass and sample, int64, shape [n, 2]."""
    loose_film: np.ndarray
    """float32, shape [n, layer_count * 4]."""


@dataclass(frozen=True)
class PassState:
    """A pass between two dispatches, bit by bit."""

    work: Pass
    sums: np.ndarray
    """Of each block, float32, shape [block_count, layer_count, pixel_count, 4]."""
    lanes: np.ndarray
    """What each path does, uint32, shape [words, lane_count, 4]; see shaders/path/state.glsl."""
    taken: int
    """Blocks of pixels that lanes have taken up, in the order of `pixel_order`; of a strip, samples."""
    image_width: int
    aside: Aside | None = None
    """What there is besides where voxels are out of core; `lanes` are then all paths that are under way."""


def finished_blocks(state: PassState, block_samples: int) -> np.ndarray:
    """Which pixels of which blocks of a pass are finished, bool, shape [block_count, pixel_count]."""
    work = state.work
    left, top, width, _ = work.window
    blocks = work.blocks(block_samples)
    if state.aside is not None:
        ends = np.minimum((np.array(blocks) + 1) * block_samples, work.samples.stop)
        return state.aside.next.reshape(len(blocks), -1) >= ends[:, None]
    done = np.arange(len(blocks) * work.pixel_count) < state.taken
    finished = np.zeros((len(blocks), work.pixel_count), bool)
    finished[:, pixel_order(work)] = done.reshape(len(blocks), work.pixel_count)
    at_work = (state.lanes[5, :, 3] != MODE_DONE) & (state.lanes[8, :, 0] != NO_PIXEL)
    pixel, sample = state.lanes[8, at_work, 0].astype(np.int64), state.lanes[8, at_work, 1].astype(np.int64)
    row, column = np.divmod(pixel, state.image_width)
    finished[sample // block_samples - blocks.start, (row - top) * width + column - left] = False
    return finished


def pixel_order(work: Pass) -> np.ndarray:
    """The pixels of a pass as lanes take them up: column by column in strips, int64, shape [pixel_count]."""
    _, _, width, height = work.window
    places = np.arange(work.pixel_count).reshape(height, width)
    strips = [places[start : start + ROWS_PER_STRIP].T.ravel() for start in range(0, height, ROWS_PER_STRIP)]
    return np.concatenate(strips)


def window_ranges(window: Window) -> tuple[range, range]:
    """Columns and rows."""
    left, top, width, height = window
    return range(left, left + width), range(top, top + height)
