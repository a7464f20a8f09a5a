"""Samples summed in blocks of 2^k per pixel, so that whoever makes which part of a picture makes its bits.

The device sums each block in float32, in the order of its samples. Blocks are folded in ascending order in
float64. Nothing else is ever added, so neither the number of blocks rendered in one go, nor where a run was
interrupted, nor which machine made which block can change a bit.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from .passes import PassState, Window, finished_blocks


@dataclass(frozen=True)
class Unit:
    """Sums over consecutive samples of a part of the picture: of one block, or of blocks already folded."""

    window: Window
    samples: range
    sums: np.ndarray
    """float32 of a block, float64 of folded ones, shape [layer_count, pixel_count, 4]."""

    @property
    def folded(self) -> bool:
        return self.sums.dtype == np.float64


@dataclass
class TileSums:
    """What is known of one part of the picture: its samples from `begin` up to `until`, without a gap."""

    window: Window
    layer_count: int
    block_samples: int
    begin: int = 0
    """First sample, at the beginning of a block. Only blocks whose predecessors are all here are folded."""
    until: int = field(init=False)
    folded: np.ndarray | None = field(init=False, default=None)
    """Of all blocks up to those in `rest`, float64, shape [layer_count, pixel_count, 4]."""
    rest: list[np.ndarray] = field(init=False, default_factory=list)
    """Of single blocks, float32; the last may lack samples, and can be continued."""

    def __post_init__(self) -> None:
        self.until = self.begin
        if self.begin == 0:
            self.folded = np.zeros((self.layer_count, self.pixel_count, 4))

    @property
    def pixel_count(self) -> int:
        return self.window[2] * self.window[3]

    @property
    def begun(self) -> np.ndarray | None:
        """Sums of the block that lacks samples, if there is one."""
        return self.rest[-1] if self.until % self.block_samples else None

    def add(self, samples: range, sums: np.ndarray) -> None:
        """The samples that follow; `sums` of each of their blocks, float32, [blocks, layers, pixels, 4]."""
        assert samples.start == self.until, "samples are added without a gap"
        if self.begun is not None:
            self.rest.pop()  # the device went on from it
        self.rest += list(sums)
        self.until = samples.stop
        if self.folded is not None:
            while len(self.rest) > (self.begun is not None):
                self.folded += self.rest.pop(0)

    def units(self) -> Iterator[Unit]:
        """All of it, in ascending order."""
        first = self.until - (self.until % self.block_samples or self.block_samples)
        first -= (len(self.rest) - 1) * self.block_samples
        first = first if self.rest else self.until
        if self.folded is not None and first > 0:
            yield Unit(self.window, range(first), self.folded)
        for block in self.rest:
            yield Unit(self.window, range(first, min(first + self.block_samples, self.until)), block)
            first += self.block_samples

    def put_back(self, unit: Unit) -> None:
        """A unit of `units`, in the same order."""
        if unit.folded:
            self.folded, self.until = unit.sums, unit.samples.stop
        else:
            self.add(unit.samples, unit.sums[None])

    def total(self, begun: PassState | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Sums in float64, [layers, pixels, 4], and the samples in them per pixel, [pixels].

        Of a pass that was interrupted those blocks of a pixel count that are finished.
        """
        total = np.zeros((self.layer_count, self.pixel_count, 4))
        if self.folded is not None:
            total += self.folded
        for block in self.rest[: len(self.rest) - (self.begun is not None and begun is not None)]:
            total += block
        samples = np.full(self.pixel_count, self.until - self.begin)
        if begun is not None:
            if self.begun is not None:
                samples -= self.until % self.block_samples
                self._add_unless_started(total, samples, begun)
            self._add_finished(total, samples, begun)
        return total, samples

    def _add_unless_started(self, total: np.ndarray, samples: np.ndarray, begun: PassState) -> None:
        """The block that lacked samples, at pixels where the pass has not finished it."""
        left = ~finished_blocks(begun, self.block_samples)[0]
        assert self.begun is not None
        total[:, left] += self.begun[:, left]
        samples[left] += self.until % self.block_samples

    def _add_finished(self, total: np.ndarray, samples: np.ndarray, begun: PassState) -> None:
        done = finished_blocks(begun, self.block_samples)
        for block, pixels, sums in zip(
            begun.work.blocks(self.block_samples), np.logical_and.accumulate(done), begun.sums, strict=True
        ):
            start = block * self.block_samples
            total[:, pixels] += sums[:, pixels]
            samples[pixels] += min(start + self.block_samples, begun.work.samples.stop) - start


def planned_windows(window: Window, rows_per_tile: int) -> list[Window]:
    """Bands that make up the window."""
    left, top, width, height = window
    return [
        (left, top + first, width, min(rows_per_tile, height - first))
        for first in range(0, height, rows_per_tile)
    ]
