"""What can be voxelized: fibers made on the fly, or explicit segments, cut into items with known boxes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np
import warp as wp

from . import kernels
from .accumulator import DEVICE
from .fingerprint import fingerprint
from .kernels import MEASURE_UNITS, TileSums, accumulate_fibers, accumulate_segments
from .tiles import TileWork, VoxelBox

if TYPE_CHECKING:
    from weft.fiber_model.fibers import FiberSet

SEGMENTS_PER_BLOCK = 64
"""Consecutive explicit segments that share one box."""


class Source(Protocol):
    """Items with boxes, each of one medium, and a way to add some of them to a tile."""

    @property
    def media(self) -> Sequence[str]:
        """Names of the media."""

    @property
    def fiber_radius_mm(self) -> Sequence[float]:
        """Fiber radius of each medium [mm]."""

    @property
    def bounds_mm(self) -> np.ndarray:
        """Box around each item [mm], shape [item_count, 2, 3]."""

    @property
    def medium(self) -> np.ndarray:
        """Medium of each item, shape [item_count]."""

    @property
    def cost(self) -> np.ndarray:
        """About how much work each item is, for the progress, shape [item_count]."""

    def fingerprint(self) -> str:
        """A hash of everything that decides the items."""

    def accumulate(self, tile: TileSums, work: TileWork, limits: tuple[wp.vec3d, wp.vec3d]) -> int:
        """Add the items of `work` to the tile; the length within `limits` of those visited first."""


class FiberSource:
    """The stretches of a `FiberSet`: every strand of each is made inside the kernel and never stored."""

    def __init__(self, fibers: FiberSet) -> None:
        self.media = fibers.type_names
        self.fiber_radius_mm = fibers.fiber_radius_mm
        self.bounds_mm = fibers.stretch_bounds()
        self.medium = fibers.stretch_type()
        self.cost = fibers.stretch_strand_counts()
        self._fibers = fibers
        self._tables = fibers.tables(DEVICE)

    def fingerprint(self) -> str:
        """Over all that the set holds, but for its report."""
        names = [field.name for field in fields(self._fibers) if field.name != "report"]
        return fingerprint((name, getattr(self._fibers, name)) for name in names)

    def accumulate(self, tile: TileSums, work: TileWork, limits: tuple[wp.vec3d, wp.vec3d]) -> int:
        """One thread per strand."""
        counts = self.cost[work.items]
        before = np.cumsum(counts) - counts
        strands = np.arange(counts.sum()) - np.repeat(before, counts)
        return _launch(
            accumulate_fibers,
            [tile, self._tables, _indices(np.repeat(work.items, counts)), _indices(strands)],
            np.repeat(work.first_visit, counts),
            limits,
        )


class SegmentSource:
    """Explicit segments [segment_count, 2, 3] in mm, all of one medium, in blocks of consecutive ones."""

    def __init__(self, segments: np.ndarray, *, fiber_radius_mm: float, medium: str = "fiber") -> None:
        self.media = (medium,)
        self.fiber_radius_mm = (fiber_radius_mm,)
        self._segments = np.ascontiguousarray(segments, dtype=np.float32)
        self._starts = np.arange(0, len(segments), SEGMENTS_PER_BLOCK)
        self._on_device = wp.array(self._segments, dtype=wp.vec3, device=DEVICE, copy=False)

    def fingerprint(self) -> str:
        return fingerprint(
            [("media", self.media), ("radius", self.fiber_radius_mm), ("segments", self._segments)]
        )

    @cached_property
    def bounds_mm(self) -> np.ndarray:
        low = np.minimum.reduceat(self._segments.min(axis=1), self._starts, axis=0)
        high = np.maximum.reduceat(self._segments.max(axis=1), self._starts, axis=0)
        return np.stack([low, high], axis=1)

    @property
    def medium(self) -> np.ndarray:
        return np.zeros(len(self._starts), dtype=np.int32)

    @property
    def cost(self) -> np.ndarray:
        return np.diff(np.r_[self._starts, len(self._segments)])

    def accumulate(self, tile: TileSums, work: TileWork, limits: tuple[wp.vec3d, wp.vec3d]) -> int:
        """One thread per segment."""
        counts = self.cost[work.items]
        before = np.cumsum(counts) - counts
        chosen = np.arange(counts.sum()) + np.repeat(self._starts[work.items] - before, counts)
        return _launch(
            accumulate_segments,
            [tile, self._on_device, _indices(chosen)],
            np.repeat(work.first_visit, counts),
            limits,
        )


def load_kernels() -> None:
    """Compile the kernels, or fetch them from Warp's cache, before threads ask for them."""
    wp.load_module(kernels, device=DEVICE)


def region_limits(region: VoxelBox, voxel_size_mm: float) -> tuple[wp.vec3d, wp.vec3d]:
    """Corners of the region in mm."""
    return wp.vec3d(*(region.low * voxel_size_mm)), wp.vec3d(*(region.high * voxel_size_mm))


def units_to_mm(length: int) -> float:
    """Length in mm from what `Source.accumulate` returned."""
    return length / MEASURE_UNITS


def _indices(values: np.ndarray) -> wp.array:
    return wp.array(values.astype(np.int32), dtype=wp.int32, device=DEVICE, copy=False)


def _launch(kernel: wp.Kernel, inputs: list, measured: np.ndarray, limits: tuple[wp.vec3d, wp.vec3d]) -> int:
    """One thread per element of `measured`; the sum of the lengths it returns."""
    length = np.zeros(len(measured), dtype=np.int64)
    flags = wp.array(measured.astype(np.uint8), dtype=wp.uint8, device=DEVICE, copy=False)
    out = wp.array(length, dtype=wp.int64, device=DEVICE, copy=False)
    wp.launch(kernel, dim=len(measured), inputs=[*inputs, flags, *limits], outputs=[out], device=DEVICE)
    return int(length.sum())
