"""What the two ways to add up a tile, Warp's kernels and their C++ twin, have in common."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

DEVICE = "cpu"
"""Where Warp makes fibers, and adds them up where the C++ twin does not."""

SUM_BYTES = 32 + 64
"""Of a voxel at most: eight sums of 32 bits, and in C++ as many of 64 where much lies; in Warp six of 64."""

IS_SEGMENT, IS_MEASURED = 1, 2
"""Flags of a segment: to be added, and its length to be measured."""

LENGTH_UNITS = 2.0**26
"""Integer units per voxel size, where a fiber is one line."""

MEASURE_UNITS = 2.0**32
"""Integer units per mm when the generated length is added up."""


def units_per_voxel(line_count: int) -> float:
    """Integer units per voxel size of fiber length, all `line_count` lines of a fiber together.

    More of them for more lines, so that a line's share has as many. A piece then counts 2^28 at most.
    """
    return LENGTH_UNITS * 2.0 ** int(math.log2(line_count))


@dataclass(frozen=True)
class TilePlace:
    """Where a tile lies, and what stands for a fiber in it."""

    origin: np.ndarray
    """First voxel, a multiple of 8, int64, shape [3]."""
    low: np.ndarray
    """First voxel that takes part; a region may cut the tile."""
    high: np.ndarray
    """One past the last voxel that takes part."""
    voxel_size_mm: float
    lines: np.ndarray
    """Where lines that stand for a fiber pierce its cross-section [mm], float32, shape [line_count, 2]."""
    region_mm: np.ndarray
    """Corners of the region within which lengths are measured, shape [2, 3]."""

    @property
    def scale(self) -> float:
        """Integer units that a voxel size of length counts in each line."""
        return units_per_voxel(len(self.lines)) / len(self.lines)


class OpenTile(Protocol):
    """A tile that takes segments."""

    @property
    def device(self) -> str:
        """Where Warp arrays are taken from; numpy's are taken too where this is "cpu"."""

    def add(self, points: Any, flags: np.ndarray, *, stride: int, order: np.ndarray | None = None) -> int:
        """Add segments, the i-th from points[i * stride] to the point after it [mm]; the measured length.

        points is float32, shape [point_count, 3]. flags, uint8, says of each segment whether it is there and
        whether it is measured. `order`, int32, names the segments to take; flags then go by place in it.
        """


class TileSums(Protocol):
    """Integer sums of all voxels of one tile."""

    @property
    def used(self) -> np.ndarray:
        """1 for each brick that received something, uint8, [brick_count]; index (x * n + y) * n + z."""

    def open(self, place: TilePlace) -> OpenTile:
        """The tile at a place. The sums must be clear."""

    def resolve(self, bricks: np.ndarray, per_unit: float, channels: Mapping[str, np.ndarray]) -> None:
        """Write the values of bricks, int32, and clear their sums; `per_unit` is the density of one unit."""
