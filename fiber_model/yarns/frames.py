"""Rotation-minimizing frames along yarns by double reflection (Wang, Juettler, Zheng and Liu 2008).

The yarns are first resampled to uniform arc length. The paper carries one normal from sample to sample; here every
sample gets a reference normal of its own, the double reflection is applied to all of them at once, and only the
turning angle between a transported reference and the next one is summed along the yarn. A frame turned by a
constant angle stays rotation-minimizing, so the result is the paper's, without a loop over samples.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .catmull_rom import CHUNK, CatmullRom, dot, norm
from .yarns import YarnSet

STEP_PER_RADIUS = 0.25
"""Default spacing of samples as a part of the yarn radius."""
MIN_INTERVALS = 8


@dataclass(frozen=True)
class YarnFrames:
    """Frames at uniform arc length along every yarn; sample i of yarn y lies at arc length i * step[y].

    A yarn of n intervals has n + 1 samples, both ends included. The last sample of a closed yarn repeats its first
    one (equal position, tangent and normal bit for bit), so interpolation over [0, length] needs no special case;
    beyond it, wrap the arc length.
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
        """Samples where curvature times yarn radius [mm], shape [yarn_count], passes 1: the inner side folds over."""
        return int((self.curvature * np.repeat(radius, np.diff(self.offsets)) > 1).sum())


def build_frames(
    yarns: YarnSet,
    *,
    max_step_mm: float | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> YarnFrames:
    """Resample every yarn to uniform arc length and give each sample a rotation-minimizing frame.

    Spacing is at most `max_step_mm` (default: a quarter of the yarn's radius) and divides the length evenly.
    Closed yarns: the angle by which the frame fails to close is spread evenly over the arc length. The set's
    material twist, if any, then turns the frame.
    """
    curves = CatmullRom.through(yarns)
    knots = curves.knots()
    length = np.array([yarn_knots[-1] for yarn_knots in knots])
    max_step = STEP_PER_RADIUS * yarns.radius if max_step_mm is None else np.full(len(length), max_step_mm)
    intervals = np.maximum(np.ceil(length / max_step * (1 - 1e-12)), MIN_INTERVALS).astype(np.int64)
    offsets = np.concatenate([[0], np.cumsum(intervals + 1)])
    position, tangent, normal = (np.empty((offsets[-1], 3)) for _ in range(3))
    curvature = np.empty(offsets[-1])
    for yarn, (begin, end) in enumerate(zip(offsets[:-1], offsets[1:], strict=True)):
        distance = np.arange(intervals[yarn] + 1) * (length[yarn] / intervals[yarn])
        part = slice(begin, end)
        u = _sample_yarn(curves, yarn, knots[yarn], distance, position[part], tangent[part], curvature[part])
        if yarns.closed[yarn]:
            _repeat_first_sample(position[part], tangent[part], curvature[part])
        angle = rotation_minimizing_angle(position[part], tangent[part])
        if yarns.closed[yarn]:
            angle -= closing_angle(angle) * np.linspace(0, 1, len(angle))
        angle += _twist_at(yarns, yarn, u)
        normal[part] = turn_reference(tangent[part], angle)
        if yarns.closed[yarn]:
            normal[end - 1] = normal[begin]
        if progress is not None and (yarn % 64 == 0):
            progress(end / offsets[-1], f"frames: yarn {yarn + 1} of {yarns.yarn_count}")
    return YarnFrames(
        position, tangent, normal, curvature, offsets, length / intervals, length, yarns.closed.copy()
    )


def rotation_minimizing_angle(position: np.ndarray, tangent: np.ndarray) -> np.ndarray:
    """Angle [rad] of the rotation-minimizing normal against `reference_normal`, zero at the first sample.

    `position` [mm] and unit `tangent`, shape [n, 3], along one yarn.
    """
    steps = np.empty(len(position))
    steps[0] = 0.0
    for begin in range(0, len(position) - 1, CHUNK):
        end = min(begin + CHUNK, len(position) - 1)
        x, t = position[begin : end + 1], tangent[begin : end + 1]
        reference = reference_normal(t)
        carried = double_reflection(x[:-1], x[1:], t[:-1], t[1:], reference[:-1])
        steps[begin + 1 : end + 1] = _angle_about(t[1:], reference[1:], carried)
    return np.cumsum(steps)


def double_reflection(
    x0: np.ndarray, x1: np.ndarray, t0: np.ndarray, t1: np.ndarray, normal: np.ndarray
) -> np.ndarray:
    """Carry `normal` from the frame at x0 with tangent t0 to the one at x1 with tangent t1 (Wang 2008, table I)."""
    carried, turned = _reflect(normal, x1 - x0), _reflect(t0, x1 - x0)
    return _reflect(carried, t1 - turned)


def reference_normal(tangent: np.ndarray) -> np.ndarray:
    """A unit normal that depends on the tangent alone: the coordinate axis farthest from it, made perpendicular."""
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
        normal[begin : begin + CHUNK] = np.cos(a) * reference + np.sin(a) * np.cross(t, reference)
    return normal


def closing_angle(angle: np.ndarray) -> float:
    """Angle in [-pi, pi) by which the frame at the end of a loop is ahead of the one at its beginning [rad]."""
    return float((angle[-1] - angle[0] + np.pi) % (2 * np.pi) - np.pi)


def _reflect(vectors: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Mirror rows of `vectors` on the plane with normal `across`; unchanged where that is zero."""
    square = dot(across, across)
    scale = np.divide(2 * dot(across, vectors), square, out=np.zeros_like(square), where=square > 0)
    return vectors - scale[:, None] * across


def _angle_about(tangent: np.ndarray, reference: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Angle [rad] from `reference` to `vectors` about the tangent."""
    return np.arctan2(dot(np.cross(tangent, reference), vectors), dot(reference, vectors))


def _sample_yarn(
    curves: CatmullRom,
    yarn: int,
    knots: np.ndarray,
    distance: np.ndarray,
    position: np.ndarray,
    tangent: np.ndarray,
    curvature: np.ndarray,
) -> np.ndarray:
    """Fill position, tangent and curvature at the arc lengths `distance`; return the curve parameter of each.

    The parameter counts control points: 2.5 lies in the middle between points 2 and 3.
    """
    parameter = np.empty(len(distance))
    for begin in range(0, len(distance), CHUNK):
        part = slice(begin, begin + CHUNK)
        segment, u = curves.parameter_at(yarn, knots, distance[part])
        velocity = curves.derivative(segment, u)
        speed = norm(velocity)
        position[part] = curves.position(segment, u)
        still = speed <= 1e-9 * knots[-1]
        tangent[part] = velocity / np.where(still, 1.0, speed)[:, None]
        tangent[part][still] = 0.0
        bend = norm(np.cross(velocity, curves.second_derivative(segment, u)))
        curvature[part] = np.where(still, 0.0, bend / np.where(still, 1.0, speed) ** 3)
        parameter[part] = segment - curves.offsets[yarn] + u
    _mend_tangents(position, tangent)
    return parameter


def _mend_tangents(position: np.ndarray, tangent: np.ndarray) -> None:
    """Where the curve stands still (repeated control points) take the direction between the neighboring samples."""
    for index in np.flatnonzero(~tangent.any(axis=1)):
        chord = position[min(index + 1, len(position) - 1)] - position[max(index - 1, 0)]
        length = np.linalg.norm(chord)
        tangent[index] = chord / length if length > 0 else (1.0, 0.0, 0.0)


def _repeat_first_sample(*arrays: np.ndarray) -> None:
    """Make the last sample of a loop equal its first, bit for bit."""
    for array in arrays:
        array[-1] = array[0]


def _twist_at(yarns: YarnSet, yarn: int, parameter: np.ndarray) -> np.ndarray | float:
    """Material twist [rad] at curve parameters, linear between control points.

    A loop's twist ends a whole number of turns from where it began, the number nearest to its last point's.
    """
    if yarns.twist is None:
        return 0.0
    twist = yarns.twist[yarns.offsets[yarn] : yarns.offsets[yarn + 1]]
    if yarns.closed[yarn]:
        turns = np.round((twist[-1] - twist[0]) / (2 * np.pi))
        twist = np.append(twist, twist[0] + 2 * np.pi * turns)
    return np.interp(parameter, np.arange(len(twist)), twist)
