"""Knits from a stitch chart: closed-form loops bent to the chart, then relaxed until no yarn is in another.

Every stitch starts as the loop of `knit.py`. The chart says whether a loop is drawn through the one below
from the back (knit) or from the front (purl): the lower half of the loop, feet and legs, takes its depth
from its own stitch, the upper half, whose head holds the next loop, from the stitch above. Cables shift
whole wales sidewise, smoothly over some courses, those in front toward the face.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from weft.fiber_model.yarns.yarns import YarnSet, refuse_too_many_points

from .knit import (
    COURSE_PER_WALE,
    DEPTH_PER_RADIUS,
    OVERLAP,
    POINTS_PER_STITCH,
    RADIUS_PER_WALE,
    SIDE_SWING,
)
from .relax import relax_repeat
from .stitch_chart import Crossing, StitchChart, read_chart

PLAIN = (1.0, COURSE_PER_WALE)
USUAL_SPACING = {
    "garter": (1.0, 0.5),
    "seed": (1.05, 0.58),
    "rib_1_1": (0.6, 0.68),
    "rib_2_2": (0.65, 0.68),
    "cable_4_front": (0.9, 0.65),
    "cable_4_back": (0.9, 0.65),
}
"""Distance between wales and between courses in stitch widths: ribs draw in, garter draws together upward."""
CABLE_DEPTH_RADII = 2.6
"""How far a cable's strands move to the face and to the back where they cross, in radii."""
LAYER_RADII = 1.8
"""How far knit wales lie before the middle, and purl wales behind it, where they are drawn together."""
UPPER_HALF, LOWER_HALF = 0.4, 0.6
"""Between these parts of pi from the head a leg passes from the depth of its head to that of its foot."""
FOOT = 0.85
"""From this part of pi on a foot passes to the depth of the next stitch."""


@dataclass(frozen=True)
class Gauge:
    """Measures of one stitch [mm]."""

    loop_width: float
    """Width of the loop, as it would be in stockinette."""
    wale: float
    """Mean distance between wales."""
    course: float
    """Distance between courses."""
    radius: float
    """Yarn radius."""


def knit_chart_yarns(
    size_mm: tuple[float, float],
    *,
    chart: str | Sequence[str],
    stitch_width_mm: float,
    wale_spacing_mm: float | None = None,
    course_spacing_mm: float | None = None,
    radius_mm: float | None = None,
    type_name: str = "yarn",
    progress: Callable[[float, str], None] | None = None,
) -> YarnSet:
    """A rectangle of knit around the origin; one repeat is relaxed and laid side by side.

    Whole stitches and courses, as many as come closest to `size_mm`, from the chart's lower left corner on.
    """
    stitches = read_chart(chart)
    gauge = chart_gauge(chart, stitch_width_mm, wale_spacing_mm, course_spacing_mm, radius_mm)
    wales = max(round(size_mm[0] / gauge.wale), 1)
    courses = max(round(size_mm[1] / gauge.course), 1)
    what = f"{courses} courses of {wales} stitches"
    refuse_too_many_points(courses * (wales * POINTS_PER_STITCH + 1), what)

    def report(part: float) -> None:
        if progress is not None:
            progress(part, "relaxing one repeat")

    repeat = knit_repeat(stitches, gauge, progress=report)
    corner = 0.5 * np.array([wales * gauge.wale, (courses - 1) * gauge.course, 0.0])
    curves = [repeated_course(repeat, gauge, course, wales) - corner for course in range(courses)]
    if progress is not None:
        progress(1.0, what)
    return YarnSet.checked(curves, radius=gauge.radius, type_names=(type_name,))


def chart_gauge(
    chart: str | Sequence[str],
    stitch_width: float,
    wale: float | None,
    course: float | None,
    radius: float | None,
) -> Gauge:
    """Measures [mm] that were given, and for the others those usual for the chart's name."""
    usual_wale, usual_course = USUAL_SPACING.get(chart, PLAIN) if isinstance(chart, str) else PLAIN
    return Gauge(
        loop_width=stitch_width,
        wale=usual_wale * stitch_width if wale is None else wale,
        course=usual_course * stitch_width if course is None else course,
        radius=RADIUS_PER_WALE * stitch_width if radius is None else radius,
    )


def repeated_course(repeat: np.ndarray, gauge: Gauge, course: int, wales: int) -> np.ndarray:
    """Control points [mm] of the first `wales` stitches of one course of the cloth, shape [n, 3]."""
    row = repeat[course % len(repeat)]
    period = row.shape[0] // POINTS_PER_STITCH * gauge.wale
    index = np.arange(wales * POINTS_PER_STITCH + 1)
    points = row[index % len(row)]
    points[:, 0] += index // len(row) * period
    points[:, 1] += course // len(repeat) * len(repeat) * gauge.course
    return points


def knit_repeat(
    chart: StitchChart, gauge: Gauge, *, progress: Callable[[float], None] | None = None
) -> np.ndarray:
    """Control points [mm] of the courses of one repeat, lowest first, shape [courses, n, 3].

    Course k lies around y = k course heights; x runs over one period from 0. Charts of one wale or course
    give two, so that no stitch touches itself in the next repeat.
    """
    chart = chart.at_least(2)
    period = (chart.wales * gauge.wale, chart.courses * gauge.course)
    drawn = drawn_loops(chart, gauge)
    rest = np.full(chart.courses, loop_length(gauge))
    if chart.crossings:  # stitches that cross over are longer
        rest = np.maximum(rest, course_lengths(drawn, period[0]) / chart.wales)
    rest /= POINTS_PER_STITCH
    courses = relax_repeat(drawn, period, gauge.radius, rest=rest, progress=progress)
    courses[..., 2] -= courses[..., 2].mean()
    return courses


def loop_length(gauge: Gauge) -> float:
    """Yarn in one stitch [mm]: as much as in a stockinette of the same loop width and usual course."""
    theta = np.linspace(-np.pi, np.pi, POINTS_PER_STITCH + 1)
    unit = gauge.loop_width / (2 * np.pi)
    height = COURSE_PER_WALE * 2 * np.pi - OVERLAP
    x, y = unit * (theta + SIDE_SWING * np.sin(2 * theta)), unit * height * np.cos(theta)
    z = DEPTH_PER_RADIUS * gauge.radius * np.cos(2 * theta)
    return float(np.sqrt(np.diff(x) ** 2 + np.diff(y) ** 2 + np.diff(z) ** 2).sum())


def course_lengths(courses: np.ndarray, period: float) -> np.ndarray:
    """Length of each closed course [mm], shape [courses]."""
    closing = courses[:, :1] + np.array([period, 0.0, 0.0])
    return np.linalg.norm(np.diff(courses, axis=1, append=closing), axis=2).sum(axis=1)


def drawn_loops(chart: StitchChart, gauge: Gauge) -> np.ndarray:
    """The courses before relaxing, shape [courses, wales * POINTS_PER_STITCH, 3]."""
    theta = np.pi * (2.0 * np.arange(POINTS_PER_STITCH + 1) / POINTS_PER_STITCH - 1.0)
    unit = gauge.loop_width / (2 * np.pi)
    height = gauge.course / unit - OVERLAP
    center, layer = wale_places(chart, gauge)
    side = drawn_side(chart, theta)
    x = center[:, None] + unit * (theta + SIDE_SWING * np.sin(2 * theta)) + 0 * side
    y = np.arange(chart.courses)[:, None, None] * gauge.course + unit * height * np.cos(theta) + 0 * side
    z = layer[:, None] - DEPTH_PER_RADIUS * gauge.radius * np.cos(2 * theta) * side
    stitches = np.stack([x, y, z], axis=-1) + cable_shifts(chart, gauge, y)
    return joined_stitches(stitches, theta, chart.wales * gauge.wale)


def drawn_side(chart: StitchChart, theta: np.ndarray) -> np.ndarray:
    """1 where a loop lies as in a knit stitch and -1 as in a purl, shape [courses, wales, points]."""
    own = np.where(chart.knit, 1.0, -1.0)
    above = np.roll(own, -1, axis=0)
    foot = smoothstep((np.abs(theta) / np.pi - UPPER_HALF) / (LOWER_HALF - UPPER_HALF))
    return own[..., None] * foot + above[..., None] * (1 - foot)


def wale_places(chart: StitchChart, gauge: Gauge) -> tuple[np.ndarray, np.ndarray]:
    """Middle of each wale along x and its depth [mm], shape [wales] each.

    Where wales are closer than loops are wide, room is saved only between wales of knits and wales of purls,
    which come to lie one behind the other as in a rib; a chart without such wales is squeezed evenly.
    """
    sign = np.where(chart.knit.all(axis=0), 1, 0) - np.where((~chart.knit).all(axis=0), 1, 0)
    changes = sign * np.roll(sign, -1) < 0
    if gauge.wale >= gauge.loop_width or not changes.any():
        return (np.arange(chart.wales) + 0.5) * gauge.wale, np.zeros(chart.wales)
    missing = chart.wales * (gauge.loop_width - gauge.wale) / changes.sum()
    step = gauge.loop_width - missing * changes
    center = np.concatenate([[0.0], np.cumsum(step)[:-1]]) + 0.5 * step[-1]
    return center, LAYER_RADII * gauge.radius * sign


def cable_shifts(chart: StitchChart, gauge: Gauge, y: np.ndarray) -> np.ndarray:
    """What cables add to the points of stitches at heights `y` [mm], shape [courses, wales, points, 3]."""
    shift = np.zeros((*y.shape, 3))
    for crossing in chart.crossings:
        for repeat in (-1, 0, 1):
            course = crossing.course + repeat * chart.courses
            place = (y / gauge.course - course + 0.5) / cable_reach(chart, crossing)
            before = (np.arange(chart.courses) < course)[:, None, None]
            done = smoothstep(0.5 + 0.5 * place)
            lean = np.where(before, done, 1 - done) * crossing.half * gauge.wale
            lift = (1 - smoothstep(np.abs(place))) * CABLE_DEPTH_RADII * gauge.radius
            left = slice(crossing.first, crossing.first + crossing.half)
            right = slice(left.stop, left.stop + crossing.half)
            # below a crossing the right wales are on their way to the left; above it they have arrived
            left_is_front = np.where(before, not crossing.left_leaning, crossing.left_leaning)
            front = np.where(left_is_front, 1.0, -1.0)[..., 0]
            for group, sign in ((left, 1.0), (right, -1.0)):
                shift[:, group, :, 0] += sign * lean[:, group]
                shift[:, group, :, 2] += sign * front[..., None] * lift[:, group]
    return shift


def cable_reach(chart: StitchChart, crossing: Crossing) -> float:
    """Courses below and above a crossing over which its wales lean: more for wide cables, within the gap."""
    gaps = [
        (other.course - crossing.course) % chart.courses or chart.courses
        for other in chart.crossings
        if abs(other.first + other.half - crossing.first - crossing.half) < other.half + crossing.half
    ]
    gaps += [chart.courses - gap for gap in gaps if gap < chart.courses]
    return min(1.0 + 0.75 * crossing.half, 0.5 * min(gaps))


def joined_stitches(stitches: np.ndarray, theta: np.ndarray, period: float) -> np.ndarray:
    """Courses of stitches whose feet are bent to meet halfway, shape [courses, wales * points, 3].

    `stitches` has both ends of every stitch, shape [courses, wales, points + 1, 3].
    """
    wrap = np.zeros((stitches.shape[1], 3))
    wrap[-1, 0] = period
    gap = np.roll(stitches[:, :, 0], -1, axis=1) + wrap - stitches[:, :, -1]
    foot = smoothstep((np.abs(theta) / np.pi - FOOT) / (1 - FOOT))[:, None]
    right, left = foot * (theta > 0)[:, None], foot * (theta < 0)[:, None]
    bent = stitches + 0.5 * gap[:, :, None] * right - 0.5 * np.roll(gap, 1, axis=1)[:, :, None] * left
    return bent[:, :, :-1].reshape(len(stitches), -1, 3)


def smoothstep(t: np.ndarray) -> np.ndarray:
    """3 t^2 - 2 t^3 for t clipped to [0, 1]."""
    t = np.clip(t, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)
