"""Samples that are finished in any order, summed in the order in which the device sums them in core.

Out of core every sample is recorded apart, because a path that waits must not hold up the samples behind it.
Float32 addition is the same here and there, so the sums of a block have the same bits.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

FIRST_FOLD = 1 << 16
"""Records that wait for an earlier one, or for others, before it is tried again to add them."""
FEW_RECORDS = 1 << 13
"""Are added together with later ones: adding takes a step for each number of a sample that occurs."""


@dataclass
class Records:
    """What single samples add to the film."""

    places: np.ndarray
    """Pixel within the pass, int64, shape [n]."""
    samples: np.ndarray
    """int64, shape [n]."""
    values: np.ndarray
    """float32, shape [n, layer_count * 4]."""

    def part(self, chosen: np.ndarray) -> Records:
        """Some of them."""
        return Records(self.places[chosen], self.samples[chosen], self.values[chosen])


def joined(parts: list[Records]) -> Records:
    """All of them, in this order."""
    return Records(
        np.concatenate([part.places for part in parts]),
        np.concatenate([part.samples for part in parts]),
        np.concatenate([part.values for part in parts]),
    )


class SampleFold:
    """Sums of the blocks of a pass, and the samples that cannot be added yet."""

    def __init__(self, sums: np.ndarray, samples: range, block_samples: int) -> None:
        """`sums`: of earlier samples, float32, shape [block_count, layer_count, pixel_count, 4]."""
        self.shape, self.block_samples = sums.shape, block_samples
        blocks, layers, pixels, _ = sums.shape
        self.first_block = samples.start // block_samples
        self.totals = np.ascontiguousarray(sums.transpose(0, 2, 1, 3)).reshape(blocks * pixels, layers * 4)
        starts = np.maximum((self.first_block + np.arange(blocks)) * block_samples, samples.start)
        self.next = np.repeat(starts, pixels)
        """The sample that each block of each pixel takes next, int64, shape [block_count * pixel_count]."""
        self.ends = np.repeat(
            np.minimum(starts // block_samples * block_samples + block_samples, samples.stop), pixels
        )
        self.loose: list[Records] = []
        self._until_fold = FIRST_FOLD

    def add(self, records: Records) -> None:
        """Finished samples, none twice."""
        rest = self._fold(records) if len(records.samples) > FEW_RECORDS else records
        if len(rest.samples):
            self.loose.append(rest)
        if sum(len(part.samples) for part in self.loose) > self._until_fold:
            self.flush()

    def flush(self) -> None:
        """Add all that can be added now."""
        if self.loose:
            rest = self._fold(joined(self.loose))
            self.loose = [rest] if len(rest.samples) else []
            self._until_fold = 2 * len(rest.samples) + FIRST_FOLD

    def sums(self) -> np.ndarray:
        """As given to the constructor."""
        blocks, layers, pixels, _ = self.shape
        return np.ascontiguousarray(self.totals.reshape(blocks, pixels, layers, 4).transpose(0, 2, 1, 3))

    def finished(self) -> np.ndarray:
        """Which pixels of which blocks have all their samples, bool, shape [block_count, pixel_count]."""
        return (self.next >= self.ends).reshape(self.shape[0], self.shape[2])

    def copy(self) -> SampleFold:
        """Another one, that adds for itself."""
        other = object.__new__(SampleFold)
        other.__dict__ |= self.__dict__ | {
            "totals": self.totals.copy(),
            "next": self.next.copy(),
            "loose": list(self.loose),
        }
        return other

    def _fold(self, records: Records) -> Records:
        """Add what follows the samples that are there, in ascending order; the rest comes back."""
        order = np.argsort(records.samples, kind="stable")
        samples = records.samples[order]
        entries = (
            (records.samples // self.block_samples - self.first_block) * self.shape[2] + records.places
        )[order]
        left = []
        bounds = [0, *(np.flatnonzero(np.diff(samples)) + 1).tolist(), len(samples)] if len(samples) else [0]
        for start, stop in itertools.pairwise(bounds):
            here, chosen = entries[start:stop], order[start:stop]
            follows = self.next[here] == samples[start]
            self.totals[here[follows]] += records.values[chosen[follows]]
            self.next[here[follows]] += 1
            left.append(chosen[~follows])
        return records.part(np.concatenate(left) if left else order)
