"""Plain knit (stockinette) from a closed form after Crane 2023, "Plain knit yarn".

In units where one wale is 2 pi wide, a course follows (t + a sin 2t, h cos t, d cos 2t) and the next one
lies c higher. Crane has a = 3/2, h = 4, d = 1, c = h + 1/2 and a tube radius of 4/5. Deviations, from a
search for the largest distance between centerlines: h = c - 0.62, so that any course spacing interlocks,
and d = 1.6 yarn radii. Four strands lie side by side in a wale, so yarns thicker than an eighth of a wale
press into each other.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from weft.fiber_model.yarns.yarns import YarnSet, refuse_too_many_points

COURSE_PER_WALE = 0.65
"""Default course spacing in wale widths."""
RADIUS_PER_WALE = 0.125
"""Default yarn radius in wale widths: neighboring strands just touch."""
POINTS_PER_STITCH = 32
SIDE_SWING = 1.487
OVERLAP = 0.62
DEPTH_PER_RADIUS = 1.6


def knit_yarns(
    size_mm: tuple[float, float],
    *,
    stitch_width_mm: float,
    course_spacing_mm: float | None = None,
    radius_mm: float | None = None,
    type_name: str = "yarn",
    progress: Callable[[float, str], None] | None = None,
) -> YarnSet:
    """A rectangle of stockinette around the origin, its technical face (the V's) toward +z.

    Whole stitches and courses, as many as come closest to `size_mm`; courses run along x and end between
    loops.
    """
    course = COURSE_PER_WALE * stitch_width_mm if course_spacing_mm is None else course_spacing_mm
    radius = RADIUS_PER_WALE * stitch_width_mm if radius_mm is None else radius_mm
    wales = max(round(size_mm[0] / stitch_width_mm), 1)
    courses = max(round(size_mm[1] / course), 1)
    refuse_too_many_points(
        courses * (wales * POINTS_PER_STITCH + 1), f"yarns.size_mm: {courses} courses of {wales} stitches"
    )
    row = knit_course(wales, stitch_width_mm, course, radius)
    heights = (np.arange(courses) - 0.5 * (courses - 1)) * course
    if progress is not None:
        progress(1.0, f"{courses} courses of {wales} stitches")
    curves = [row + np.array([0.0, y, 0.0]) for y in heights]
    return YarnSet.checked(curves, radius=radius, type_names=(type_name,))


def knit_course(wales: int, stitch_width: float, course_spacing: float, radius: float) -> np.ndarray:
    """Control points [mm] of one course centered at the origin, shape [n, 3]."""
    unit = stitch_width / (2 * np.pi)
    count = wales * POINTS_PER_STITCH
    t = np.pi + 2 * np.pi * wales * np.arange(count + 1) / count
    height = course_spacing / unit - OVERLAP
    x = t - np.pi * (wales + 1) + SIDE_SWING * np.sin(2 * t)
    y = height * np.cos(t)
    return np.stack([unit * x, unit * y, -DEPTH_PER_RADIUS * radius * np.cos(2 * t)], axis=1)
