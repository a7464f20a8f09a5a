"""Rotation-minimizing frames along yarns by double reflection (Wang, Juettler, Zheng and Liu 2008).

The yarns are first resampled to uniform arc length. The paper carries one normal from sample to sample.
Here every sample gets a reference normal of its own, the double reflection carries all of them one step at
once, and only the angle between a carried reference and the next one is summed along the yarn. Carrying
commutes with turning about the tangent, so the result is the paper's, without a loop over samples.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .catmull_rom import CHUNK, PIECES, CatmullRom, cross, dot, norm
from .yarns import YarnSet

STEP_PER_RADIUS = 0.25
"""Default spacing of samples as a part of the yarn radius."""
MIN_INTERVALS = 8


@dataclass(frozen=True)
class YarnFrames:
    """Frames at uniform arc length along every yarn; sample i of yarn y lies at arc length i * step[y].

    A yarn of n intervals has n + 1 samples, both ends included. The last sample of a closed yarn repeats its
    first one (equal position, tangent, normal, bit for bit), so interpolation over [0, length] needs no
    special case; beyond it, wrap the arc length.
    """

    position: np.ndarray
    """Centerline [mm], float64, shape [sample_count, 3]."""
    tangent: np.ndarray
    """Unit tangent, float64, shape [sample_count, 3]."""
    normal: np.ndarray
    """Unit normal, float64, shape [sample_count, 3]; binormal = tangent x normal. Material twist included."""
    curvature: np.ndarray
    """Curvature [1/mm], float64, shape [sample_count]."""
    offsets: np.ndarray
    """First sample of each yarn, int64, shape [yarn_count + 1]."""
    step: np.ndarray
    """Arc length between samples [mm], exactly length / intervals, float64, shape [yarn_count]."""
    length: np.ndarray
    """Arc length of each yarn [mm], float64, shape [yarn_count]."""
    closed: np.ndarray
    """Whether the yarn is a loop, bool, shape [yarn_count]."""

    @property
    def yarn_count(self) -> int:
        """Number of yarns."""
        return len(self.length)

    @property
    def interval_counts(self) -> np.ndarray:
        """Intervals per yarn, one less than its samples, int64, shape [yarn_count]."""
        return np.diff(self.offsets) - 1

    @property
    def arc_length(self) -> np.ndarray:
        """Distance of each sample from the beginning of its yarn [mm], float64, shape [sample_count]."""
        index = np.arange(self.offsets[-1]) - np.repeat(self.offsets[:-1], np.diff(self.offsets))
        return index * np.repeat(self.step, np.diff(self.offsets))

    def folded_count(self, radius: np.ndarray) -> int:
        """Samples whose curvature times yarn `radius` [mm], shape [yarn_count], passes 1: they fold."""
        return int((self.curvature * np.repeat(radius, np.diff(self.offsets)) > 1).sum())


def build_frames(
    yarns: YarnSet,
    *,
    max_step_mm: float | None = None,
) -> YarnFrames:
    """Resample every yarn to uniform arc length and give each sample a rotation-minimizing frame.

    Spacing is at most `max_step_mm` (default: a quarter of the yarn's radius) and divides the length evenly.
    Closed yarns: the angle by which the frame fails to close is spread evenly over the arc length. The set's
    material twist, if any, then turns the frame.
    """
    curves = CatmullRom.through(yarns)
    knots = curves.knots()
    length = knots[curves.knot_offsets[1:] - 1]
    max_step = STEP_PER_RADIUS * yarns.radius if max_step_mm is None else np.full(len(length), max_step_mm)
    intervals = np.maximum(np.ceil(length / max_step * (1 - 1e-12)), MIN_INTERVALS).astype(np.int64)
    offsets = np.concatenate([[0], np.cumsum(intervals + 1)])
    step = length / intervals

    piece = locate_pieces(curves, knots, step, offsets)
    position, tangent, curvature, parameter = _sample(curves, knots, step, offsets, piece)
    _repeat_first_sample(yarns.closed, offsets, position, tangent, curvature)
    angle = rotation_minimizing_angle(position, tangent, offsets)
    _close_angle(yarns.closed, offsets, angle)
    if yarns.twist is not None:
        angle += _twist_at(yarns, curves, parameter, offsets)
    normal = turn_reference(tangent, angle)
    _repeat_first_sample(yarns.closed, offsets, normal)
    return YarnFrames(position, tangent, normal, curvature, offsets, step, length, yarns.closed.copy())


def rotation_minimizing_angle(position: np.ndarray, tangent: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """Angle [rad] of the rotation-minimizing normal against `reference_normal`, zero where a yarn begins.

    `position` [mm] and unit `tangent`, shape [n, 3], yarn after yarn as in `offsets`.
    """
    angle = np.zeros(len(position))
    for begin in range(0, len(position) - 1, CHUNK):
        end = min(begin + CHUNK, len(position) - 1)
        x, t = position[begin : end + 1], tangent[begin : end + 1]
        reference = reference_normal(t)
        carried = double_reflection(x[:-1], x[1:], t[:-1], t[1:], reference[:-1])
        angle[begin + 1 : end + 1] = _angle_about(t[1:], reference[1:], carried)
    for begin, end in pairwise(offsets):
        angle[begin] = 0.0
        np.cumsum(angle[begin:end], out=angle[begin:end])
    return angle


def double_reflection(
    x0: np.ndarray, x1: np.ndarray, t0: np.ndarray, t1: np.ndarray, normal: np.ndarray
) -> np.ndarray:
    """Carry `normal` from the frame (x0, t0) to the frame (x1, t1) (Wang et al. 2008, table I)."""
    carried, turned = _reflect(normal, x1 - x0), _reflect(t0, x1 - x0)
    return _reflect(carried, t1 - turned)


def reference_normal(tangent: np.ndarray) -> np.ndarray:
    """A unit normal given by the tangent alone: the coordinate axis farthest from it, made perpendicular."""
    axis = np.zeros_like(tangent)
    axis[np.arange(len(tangent)), np.argmin(np.abs(tangent), axis=1)] = 1.0
    normal = axis - dot(axis, tangent)[:, None] * tangent
    return normal / norm(normal)[:, None]


def turn_reference(tangent: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """The normal at `angle` [rad] from `reference_normal`, counterclockwise seen against the tangent."""
    normal = np.empty_like(tangent)
    for begin in range(0, len(tangent), CHUNK):
        t, a = tangent[begin : begin + CHUNK], angle[begin : begin + CHUNK, None]
        reference = reference_normal(t)
        normal[begin : begin + CHUNK] = np.cos(a) * reference + np.sin(a) * cross(t, reference)
    return normal


def _reflect(vectors: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Mirror rows of `vectors` on the plane with normal `across`; unchanged where that is zero."""
    square = dot(across, across)
    scale = np.divide(2 * dot(across, vectors), square, out=np.zeros_like(square), where=square > 0)
    return vectors - scale[:, None] * across


def _angle_about(tangent: np.ndarray, reference: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Angle [rad] from `reference` to `vectors` about the tangent."""
    return np.arctan2(dot(cross(tangent, reference), vectors), dot(reference, vectors))


def locate_pieces(curves: CatmullRom, knots: np.ndarray, step: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """Quadrature piece that holds each sample, int64, shape [sample_count]."""
    piece = np.empty(offsets[-1], np.int64)
    knot_offsets = curves.knot_offsets
    for yarn, (begin, end) in enumerate(pairwise(offsets)):
        inner_knots = knots[knot_offsets[yarn] + 1 : knot_offsets[yarn + 1] - 1]
        local = np.searchsorted(inner_knots, np.arange(end - begin) * step[yarn], side="right")
        piece[begin:end] = local + curves.offsets[yarn] * PIECES
    return piece


def _sample(
    curves: CatmullRom, knots: np.ndarray, step: np.ndarray, offsets: np.ndarray, piece: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Position, unit tangent, curvature and curve parameter (segment + u) at every sample."""
    count = len(piece)
    position, tangent = np.empty((count, 3)), np.empty((count, 3))
    curvature, parameter = np.empty(count), np.empty(count)
    for begin in range(0, count, CHUNK):
        part = slice(begin, begin + CHUNK)
        index = np.arange(begin, min(begin + CHUNK, count))
        yarn = np.searchsorted(offsets, index, side="right") - 1
        knot = piece[part] + yarn  # every yarn before this one has one knot more than pieces
        target = (index - offsets[yarn]) * step[yarn] - knots[knot]
        u = curves.parameter_at(piece[part], knots[knot + 1] - knots[knot], target)
        segment = piece[part] // PIECES
        position[part], velocity, acceleration = curves.jets(segment, u)
        tangent[part], curvature[part] = _tangent_and_curvature(velocity, acceleration, step[yarn])
        parameter[part] = segment + u
    _mend_tangents(position, tangent)
    return position, tangent, curvature, parameter


def _tangent_and_curvature(
    velocity: np.ndarray, acceleration: np.ndarray, step: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Unit tangent, and |p' x p''| / |p'|^3 [1/mm]; both zero where the curve stands still."""
    speed = norm(velocity)
    speed = np.where(speed > 1e-9 * step, speed, np.inf)
    return velocity / speed[:, None], norm(cross(velocity, acceleration)) / (speed * speed * speed)


def _mend_tangents(position: np.ndarray, tangent: np.ndarray) -> None:
    """Where a curve stands still (repeated control points) take the direction between neighboring samples."""
    still = np.flatnonzero(~tangent.any(axis=1))
    chord = position[np.minimum(still + 1, len(position) - 1)] - position[np.maximum(still - 1, 0)]
    length = norm(chord)
    chord[length == 0] = (1.0, 0.0, 0.0)
    tangent[still] = chord / np.where(length > 0, length, 1.0)[:, None]


def _repeat_first_sample(closed: np.ndarray, offsets: np.ndarray, *arrays: np.ndarray) -> None:
    """Make the last sample of every loop equal its first, bit for bit."""
    for array in arrays:
        array[offsets[1:][closed] - 1] = array[offsets[:-1][closed]]


def _close_angle(closed: np.ndarray, offsets: np.ndarray, angle: np.ndarray) -> None:
    """Spread the angle by which each loop's frame fails to close, at most half a turn, over its length."""
    for yarn in np.flatnonzero(closed):
        part = angle[offsets[yarn] : offsets[yarn + 1]]
        excess = (part[-1] + np.pi) % (2 * np.pi) - np.pi
        part -= excess * np.linspace(0.0, 1.0, len(part))


def _twist_at(yarns: YarnSet, curves: CatmullRom, parameter: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """Material twist [rad] at curve parameters, linear between control points.

    A loop's twist ends a whole number of turns from where it began, the number nearest to its last point's.
    """
    assert yarns.twist is not None
    result = np.empty(len(parameter))
    for yarn, (begin, end) in enumerate(pairwise(offsets)):
        twist = yarns.twist[yarns.offsets[yarn] : yarns.offsets[yarn + 1]]
        if yarns.closed[yarn]:
            turns = np.round((twist[-1] - twist[0]) / (2 * np.pi))
            twist = np.append(twist, twist[0] + 2 * np.pi * turns)
        knots = curves.offsets[yarn] + np.arange(len(twist))
        result[begin:end] = np.interp(parameter[begin:end], knots, twist)
    return result
