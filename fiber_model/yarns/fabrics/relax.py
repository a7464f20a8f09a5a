"""Relaxing one repeat of a cloth: lengths kept, yarns pushed apart until they touch.

Position-based dynamics (Müller, Heidelberger, Hennix and Ratcliff 2007) without time: every pass unbends each
yarn a little, pulls its segments to their length, and pushes apart segments closer than two radii. All
corrections of a kind come from the same positions and are averaged per point, so their order does not matter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from weft.fiber_model.yarns.catmull_rom import dot, norm

PASSES = 400
BENDS = 4
"""Bending steps in a pass."""
STIFFNESS = 0.4
"""Size of a bending step [1], at most 0.5; falls in the second half, so that contacts have the last word."""
LAST_STIFFNESS = 0.2
"""What is left of that at the end [1]: without any, yarns kink where they touch."""
MARGIN = 1.02
"""Distance [diameters] that passes strive for: what they leave of an overlap, and the corners that polylines
cut off curves, then stay above or near one."""
EXEMPT_RADII = 4.0
"""Stretches of a yarn closer than this many radii along it do not repel each other."""
SOFT_RADII = 0.01
"""Overlaps of a point, together, below which it is moved less than by all of them."""


@dataclass(frozen=True)
class Ring:
    """Courses as closed polylines: the last segment of each leads to its first point in the next repeat."""

    after: np.ndarray
    """Next point of each point, shape [n]."""
    wrap: np.ndarray
    """What to add to the next point [mm], shape [n, 3]: one period where a course closes."""
    per_course: int
    """Points per course."""
    period: np.ndarray
    """Size of the repeat along x and y [mm], shape [2]."""

    @classmethod
    def of(cls, shape: tuple[int, ...], period: tuple[float, float]) -> Ring:
        """Courses with points of `shape` [course_count, per_course, 3]."""
        index = np.arange(shape[0] * shape[1]).reshape(shape[:2])
        wrap = np.zeros(shape)
        wrap[:, -1, 0] = period[0]
        return cls(np.roll(index, -1, axis=1).reshape(-1), wrap.reshape(-1, 3), shape[1], np.array(period))

    def chords(self, points: np.ndarray) -> np.ndarray:
        """From each point to the next [mm]."""
        return points[self.after] + self.wrap - points

    def to_middle(self, values: np.ndarray, wrap: np.ndarray | float = 0.0) -> np.ndarray:
        """From each value to the mean of its neighbors' along the course."""
        to_next = values[self.after] + wrap - values
        from_last = np.empty_like(to_next)
        from_last[self.after] = to_next
        return 0.5 * (to_next - from_last)


def relax_repeat(
    courses: np.ndarray,
    period: tuple[float, float],
    radius: float,
    *,
    rest: np.ndarray,
    passes: int = PASSES,
    progress: Callable[[float], None] | None = None,
) -> np.ndarray:
    """The control points [mm] of relaxed courses, shape [course_count, n, 3], like `courses`.

    Each course repeats after `period[0]` [mm] along x, where its last point joins its first, and all of them
    after `period[1]` along y. Segments strive for the length that `rest` [mm], shape [course_count], has for
    their course.
    """
    ring = Ring.of(courses.shape, period)
    points = courses.reshape(-1, 3).copy()
    lengths = np.repeat(rest, ring.per_course)
    for step in range(passes):
        for _ in range(BENDS):
            points += STIFFNESS * _fading(step / passes) * _unbent(ring, points)
        for _ in range(2):
            points += _lengthened(ring, points, lengths)
        points += _pushed_apart(ring, points, radius)
        if progress is not None and step % 20 == 0:
            progress(step / passes)
    return points.reshape(courses.shape)


def _fading(part: float) -> float:
    """1 in the first half of the passes, then falling until four fifths."""
    return float(np.clip((0.8 - part) / 0.3, LAST_STIFFNESS, 1.0))


def _unbent(ring: Ring, points: np.ndarray) -> np.ndarray:
    """Steepest descent [mm] of the bending energy, the sum of squares of second differences."""
    return -ring.to_middle(ring.to_middle(points, ring.wrap))


def _lengthened(ring: Ring, points: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """Corrections [mm] toward segments of `lengths`: each end takes half, and three quarters of that."""
    chord = ring.chords(points)
    share = 0.375 * (1.0 - lengths / np.maximum(norm(chord), 1e-9 * lengths))[:, None] * chord
    moved = share.copy()
    moved[ring.after] -= share
    return moved


def _pushed_apart(ring: Ring, points: np.ndarray, radius: float) -> np.ndarray:
    """Corrections [mm] that bring segments nearer than touching to touching distance."""
    touching = 2 * radius * MARGIN
    chord = ring.chords(points)
    first, second = _close_pairs(ring, points + 0.5 * chord, norm(chord), touching, radius)
    apart = points[second] - points[first]
    middle = (apart + 0.5 * (chord[second] - chord[first]))[:, :2]
    apart[:, :2] -= ring.period * np.round(middle / ring.period)
    u, v = closest_parameters(chord[first], chord[second], apart)
    between = apart + v[:, None] * chord[second] - u[:, None] * chord[first]
    distance = np.maximum(norm(between), 1e-9 * radius)
    overlap = np.maximum(touching - distance, 0.0)
    push = (0.5 * overlap / distance)[:, None] * between
    ends = (first, ring.after[first], second, ring.after[second])
    shares = np.concatenate([(1 - u) * overlap, u * overlap, (1 - v) * overlap, v * overlap])
    return _averaged(np.concatenate(ends), shares, np.concatenate([-push, -push, push, push]), radius, points)


def _averaged(
    index: np.ndarray, shares: np.ndarray, push: np.ndarray, radius: float, points: np.ndarray
) -> np.ndarray:
    """Mean of the pushes on each point, weighted by overlap and nearness, shape of `points`."""
    weight = np.bincount(index, shares, minlength=len(points))
    total = [np.bincount(index, shares * push[:, axis], minlength=len(points)) for axis in range(3)]
    return np.stack(total, axis=1) / np.maximum(weight, SOFT_RADII * radius)[:, None]


def _close_pairs(
    ring: Ring, middle: np.ndarray, length: np.ndarray, touching: float, radius: float
) -> tuple[np.ndarray, np.ndarray]:
    """Segments that may be nearer than touching, in any repeat, but not neighbors along a yarn."""
    from scipy.spatial import cKDTree

    wrapped = middle.copy()
    wrapped[:, :2] %= ring.period
    wrapped[:, :2][wrapped[:, :2] >= ring.period] = 0.0  # the remainder of a tiny negative number
    tree = cKDTree(wrapped, boxsize=[*ring.period, 0.0])
    pairs = tree.query_pairs(touching + float(length.max()), output_type="ndarray")
    first, second = pairs[:, 0], pairs[:, 1]
    along = np.abs(first - second)
    along = np.minimum(along, ring.per_course - along)
    same = first // ring.per_course == second // ring.per_course
    chosen = ~same | (along * length.mean() >= EXEMPT_RADII * radius)
    return first[chosen], second[chosen]


def closest_parameters(a: np.ndarray, b: np.ndarray, apart: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where segments p + u a and p + apart + v b are nearest, u and v in [0, 1], shape [n] each.

    After Ericson 2005, "Real-time collision detection", section 5.1.9.
    """
    aa, bb, ab = np.maximum(dot(a, a), 1e-30), np.maximum(dot(b, b), 1e-30), dot(a, b)
    ad, bd = dot(a, apart), dot(b, apart)
    determinant = aa * bb - ab * ab
    parallel = determinant <= 1e-9 * aa * bb
    u = np.clip(np.where(parallel, 0.5, (ad * bb - bd * ab) / np.where(parallel, 1.0, determinant)), 0, 1)
    v = np.clip((u * ab - bd) / bb, 0, 1)
    return np.clip((v * ab + ad) / aa, 0, 1), v
