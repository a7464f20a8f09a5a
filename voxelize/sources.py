"""What can be voxelized: fibers made on the fly, or explicit segments, cut into items with known boxes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from .fingerprint import fingerprint
from .tile_sums import IS_MEASURED, IS_SEGMENT, MEASURE_UNITS, OpenTile
from .tiles import TileWork

if TYPE_CHECKING:
    from weft.fiber_model.fibers import FiberSet

SEGMENTS_PER_BLOCK = 64
"""Consecutive explicit segments that share one box."""

POINTS_AT_ONCE = 1 << 16
"""Points of fibers made before they are added to a tile: they are still in the cache then."""


ColoredSegments = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Points and their colors, float32, shape [n, 3], and as uint8 [n] whether a segment goes on to the next."""


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

    @property
    def has_colors(self) -> bool:
        """Whether any fiber is not white."""

    def fingerprint(self) -> str:
        """A hash of everything that decides the items."""

    def accumulate(self, tile: OpenTile, work: TileWork) -> int:
        """Add the items of `work` to the tile; the length within its region of those visited first."""

    def colored(self, work: TileWork) -> Iterator[ColoredSegments]:
        """The items' segments with colors; nothing for fibers without any."""


class FiberSource:
    """The stretches of a `FiberSet`: made a few at a time where a tile needs them, and never stored."""

    def __init__(self, fibers: FiberSet) -> None:
        self.media = fibers.type_names
        self.fiber_radius_mm = fibers.fiber_radius_mm
        self.bounds_mm = fibers.stretch_bounds()
        self.medium = fibers.stretch_type()
        self.cost = fibers.stretch_strand_counts()
        self._fibers = fibers
        self._tables = fibers.tables()
        hairs = fibers.stretches["hairs"]
        self._points = fibers.stretch_point_counts()
        self._strand_counts = np.stack([self.cost - hairs, hairs], axis=1)
        body = fibers.stretches["segments"] + 1
        self._strand_points = np.stack([body, np.full_like(body, fibers.config.hair_segments + 1)], axis=1)

    @property
    def has_colors(self) -> bool:
        from weft.fiber_model.fiber_colors import has_colors

        return has_colors(self._fibers)

    def fingerprint(self) -> str:
        """Over all that the set holds, but for its report."""
        names = [field.name for field in fields(self._fibers) if field.name != "report"]
        return fingerprint((name, getattr(self._fibers, name)) for name in names)

    def accumulate(self, tile: OpenTile, work: TileWork) -> int:
        """All points of a few stretches at a time, by one thread."""
        before = np.cumsum(self._points[work.items]) // POINTS_AT_ONCE
        starts = np.flatnonzero(np.diff(before, prepend=-1))
        length = 0
        for begin, end in zip(starts, np.r_[starts[1:], len(work.items)], strict=True):
            items = work.items[begin:end]
            points, flags = self._make(tile.device, items, work.first_visit[begin:end])
            length += tile.add(points, flags, stride=1)
        return length

    def colored(self, work: TileWork) -> Iterator[ColoredSegments]:
        """The points of a few stretches at a time, with their colors."""
        import warp as wp

        from weft.fiber_model.color_kernels import colors_kernel

        if not self.has_colors:
            return
        before = np.cumsum(self._points[work.items]) // POINTS_AT_ONCE
        starts = np.flatnonzero(np.diff(before, prepend=-1))
        for begin, end in zip(starts, np.r_[starts[1:], len(work.items)], strict=True):
            items = work.items[begin:end]
            points, flags = self._make("cpu", items, work.first_visit[begin:end])
            colors = np.empty((len(points), 3), np.float32)
            counts = self._points[items]
            inputs = [
                0,
                self._tables,
                wp.array(items.astype(np.int32), dtype=wp.int32, device="cpu"),
                wp.array((np.cumsum(counts) - counts).astype(np.int64), dtype=wp.int64, device="cpu"),
                wp.array(colors, dtype=wp.vec3, device="cpu", copy=False),
            ]
            wp.launch(colors_kernel, len(items), inputs=inputs, device="cpu")
            yield points, colors, flags

    def _make(self, device: str, stretches: np.ndarray, measured: np.ndarray) -> tuple[Any, np.ndarray]:
        """The points of all strands of the stretches, and the flags of the segments that begin in them."""
        import warp as wp

        from weft.fiber_model.strand_kernels import points_kernel

        counts = self._points[stretches]
        offsets, total = np.cumsum(counts) - counts, int(counts.sum())
        if wp.get_device(device).is_cpu:
            made: Any = np.empty((total, 3), np.float32)
            points = wp.array(made, dtype=wp.vec3, device=device, copy=False)
        else:
            made = points = wp.empty(total, dtype=wp.vec3, device=device)
        inputs = [
            0,
            self._tables,
            wp.array(stretches.astype(np.int32), dtype=wp.int32, device=device, copy=False),
            wp.array(offsets.astype(np.int64), dtype=wp.int64, device=device, copy=False),
            points,
            wp.empty(total, dtype=wp.uint8, device=device),
        ]
        wp.launch(points_kernel, len(stretches), inputs=inputs, device=device)
        strand_points = np.repeat(
            self._strand_points[stretches].ravel(), self._strand_counts[stretches].ravel()
        )
        flags = np.repeat(np.where(measured, IS_SEGMENT | IS_MEASURED, IS_SEGMENT).astype(np.uint8), counts)
        flags[np.cumsum(strand_points) - 1] = 0
        return made, flags


class SegmentSource:
    """Explicit segments [segment_count, 2, 3] in mm, all of one medium, in blocks of consecutive ones."""

    def __init__(self, segments: np.ndarray, *, fiber_radius_mm: float, medium: str = "fiber") -> None:
        self.media = (medium,)
        self.fiber_radius_mm = (fiber_radius_mm,)
        self.has_colors = False
        self._segments = np.ascontiguousarray(segments, dtype=np.float32)
        self._starts = np.arange(0, len(segments), SEGMENTS_PER_BLOCK)

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

    def colored(self, work: TileWork) -> Iterator[ColoredSegments]:
        """None: explicit segments are white."""
        return iter(())

    def accumulate(self, tile: OpenTile, work: TileWork) -> int:
        """All at once."""
        counts = self.cost[work.items]
        before = np.cumsum(counts) - counts
        chosen = np.arange(counts.sum()) + np.repeat(self._starts[work.items] - before, counts)
        flags = np.where(work.first_visit, IS_SEGMENT | IS_MEASURED, IS_SEGMENT).astype(np.uint8)
        return tile.add(
            self._segments.reshape(-1, 3),
            np.repeat(flags, counts),
            stride=2,
            order=chosen.astype(np.int32),
        )


def units_to_mm(length: int) -> float:
    """Length in mm from what `Source.accumulate` returned."""
    return length / MEASURE_UNITS
