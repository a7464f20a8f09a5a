"""Cubic curves of other kinds as Catmull-Rom control points that follow them to a tolerance.

A yarn is a uniform Catmull-Rom curve through its points. Where a file holds Bezier curves or B-splines,
points at equal arc lengths are taken from them, as few as keep the Catmull-Rom curve within the tolerance;
a curve that is already one through the ends of its segments keeps those. The distance is taken three times
between neighboring points, at equal parameters, where it can only be larger than the distance to the curve.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np

from weft.fiber_model.yarns.catmull_rom import PIECES, CatmullRom, norm
from weft.fiber_model.yarns.frames import locate_pieces
from weft.fiber_model.yarns.yarns import MAX_COORDINATE_MM, MIN_POINTS, YarnSet
from weft.files.errors import InputError

TOLERANCE = 0.01
"""Largest distance between a curve and the Catmull-Rom curve that replaces it, in yarn radii."""
PARTS = 4
"""Parts of an interval between control points; the distance is taken where they meet."""
GROWTH = 1.5
"""Factor on the number of intervals after a failure."""
MAX_PER_RADIUS = 64
"""Intervals per yarn radius at which even a corner is followed; more are never needed."""
MAX_PER_SEGMENT = 64
"""Most intervals per segment of the given curve, counted as four at least."""
MAX_INTERVALS = 1_000_000
CHUNK_SEGMENTS = 1024
"""Segments handled at once, to bound the memory of temporaries."""

BASES = {
    "bezier": np.array([[1, 0, 0, 0], [-3, 3, 0, 0], [3, -6, 3, 0], [-1, 3, -3, 1]], float),
    "bspline": np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]], float) / 6,
    "catmullRom": np.array([[0, 2, 0, 0], [-1, 0, 1, 0], [2, -5, 4, -1], [-1, 3, -3, 1]], float) / 2,
}
"""Coefficients of the powers of u (rows) from the four control points of a segment (columns)."""


def follow_curves(
    curves: CatmullRom, closed: np.ndarray, radius: np.ndarray, *, source: str | Path | None = None
) -> list[np.ndarray]:
    """Control points [mm], shape [n, 3], for each of `curves`, within `TOLERANCE` of its yarn's radius [mm].

    `curves` may hold any cubic polynomials; the segments of one curve follow each other without gaps.
    """
    _refuse_unusable(curves, radius, source)
    followed: list[np.ndarray] = []
    for begin, end in _chunks(curves.offsets):
        first, last = curves.offsets[begin], curves.offsets[end]
        part = CatmullRom(curves.coefficients[first:last], curves.offsets[begin : end + 1] - first)
        followed += _follow(part, closed[begin:end], TOLERANCE * radius[begin:end])
    for yarn, points in enumerate(followed):
        if not len(points):
            what = f"yarn {yarn} bends too sharply to be followed to within {TOLERANCE:g} yarn radii"
            raise InputError(f"{what}; check its unit and radius", path=source)
    return followed


def _refuse_unusable(curves: CatmullRom, radius: np.ndarray, source: str | Path | None) -> None:
    """Refuse what `YarnSet` would, before time is spent on it."""
    bad_radius = ~(np.isfinite(radius) & (radius > 0))
    if bad_radius.any():
        yarn = int(np.argmax(bad_radius))
        what = f"yarn {yarn} has radius {radius[yarn]:g} mm; need a positive number"
        raise InputError(what, path=source)
    far = ~(np.abs(curves.coefficients).max(axis=(1, 2)) <= 10 * MAX_COORDINATE_MM)
    if far.any():
        yarn = int(np.searchsorted(curves.offsets, np.argmax(far), side="right")) - 1
        what = f"yarn {yarn} is not finite or reaches beyond ten kilometers; check the unit"
        raise InputError(what, path=source)
    still = curves.lengths() == 0
    if still.any():
        what = f"yarn {int(np.argmax(still))} has no length: all its points coincide"
        raise InputError(what, path=source)


def _chunks(offsets: np.ndarray) -> Iterator[tuple[int, int]]:
    """Ranges of curves that have few segments together, or are one curve."""
    begin, count = 0, len(offsets) - 1
    while begin < count:
        end = int(np.searchsorted(offsets, offsets[begin] + CHUNK_SEGMENTS, side="right")) - 1
        end = max(end, begin + 1)
        yield begin, end
        begin = end


def _follow(curves: CatmullRom, closed: np.ndarray, tolerance: np.ndarray) -> list[np.ndarray]:
    """Control points of each curve; none where it would take too many."""
    followed = [np.empty((0, 3))] * len(closed)
    intervals = np.diff(curves.offsets)
    enough = np.flatnonzero(intervals + ~closed >= MIN_POINTS)
    _keep_close(followed, enough, *_at_equal_parameters(curves, enough), closed, tolerance)
    intervals = np.maximum(intervals, MIN_POINTS)
    knots = curves.knots()
    length = knots[curves.knot_offsets[1:] - 1]
    most = np.minimum(MAX_PER_SEGMENT * intervals, np.maximum(MAX_INTERVALS, 2 * intervals))
    most = np.minimum(most, GROWTH * MAX_PER_RADIUS * TOLERANCE * length / tolerance)
    most = np.maximum(most, intervals)
    while True:
        missing = np.array([not len(points) for points in followed])
        pending = np.flatnonzero(missing & (intervals <= most))
        if not len(pending):
            return followed
        samples = _at_equal_lengths(curves, knots, intervals[pending], pending)
        _keep_close(followed, pending, *samples, closed, tolerance)
        intervals[pending] = np.ceil(intervals[pending] * GROWTH).astype(np.int64)


def _at_equal_parameters(curves: CatmullRom, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`PARTS` points on each segment of the chosen curves and their ends; where each curve's begin."""
    segments = [np.arange(curves.offsets[curve], curves.offsets[curve + 1]) for curve in chosen]
    index = [np.append(np.repeat(part, PARTS), part[-1]) for part in segments]
    u = [np.append(np.tile(np.arange(PARTS) / PARTS, len(part)), 1.0) for part in segments]
    offsets = np.cumsum([0] + [len(part) for part in index])
    if not len(chosen):
        return np.empty((0, 3)), offsets
    return curves.position(np.concatenate(index), np.concatenate(u)), offsets


def _at_equal_lengths(
    curves: CatmullRom, knots: np.ndarray, intervals: np.ndarray, chosen: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Points at `PARTS` * `intervals` equal arc lengths of the chosen curves and their ends."""
    counts = np.zeros(len(curves.offsets) - 1, np.int64)
    counts[chosen] = PARTS * intervals + 1
    offsets = np.concatenate([[0], np.cumsum(counts)])
    step = knots[curves.knot_offsets[1:] - 1] / np.maximum(counts - 1, 1)
    piece = locate_pieces(curves, knots, step, offsets)
    curve = np.repeat(np.arange(len(counts)), counts)
    knot = piece + curve  # every curve before this one has one knot more than pieces
    target = (np.arange(offsets[-1]) - offsets[curve]) * step[curve] - knots[knot]
    u = curves.parameter_at(piece, knots[knot + 1] - knots[knot], target)
    return curves.position(piece // PIECES, u), np.append(offsets[chosen], offsets[-1])


def _keep_close(
    followed: list[np.ndarray],
    chosen: np.ndarray,
    samples: np.ndarray,
    offsets: np.ndarray,
    closed: np.ndarray,
    tolerance: np.ndarray,
) -> None:
    """Fill in the control points of those chosen curves whose Catmull-Rom curve stays by the samples."""
    if not len(chosen):
        return
    controls, between = [], []
    for curve, (begin, end) in zip(chosen, pairwise(offsets), strict=True):
        part = samples[begin:end]
        controls.append(part[:-1:PARTS] if closed[curve] else part[::PARTS])
        between.append(part[:-1].reshape(-1, PARTS, 3)[:, 1:])
    candidates = CatmullRom.through(YarnSet.checked(controls, closed=closed[chosen].tolist(), radius=1.0))
    inside = np.concatenate(between)
    segment = np.arange(len(inside))
    distance = np.zeros(len(inside))
    for step in range(1, PARTS):
        point = candidates.position(segment, np.full(len(inside), step / PARTS))
        distance = np.maximum(distance, norm(point - inside[:, step - 1]))
    worst = np.maximum.reduceat(distance, candidates.offsets[:-1])
    for curve, points, error in zip(chosen, controls, worst, strict=True):
        if error <= tolerance[curve]:
            followed[curve] = points.copy()
