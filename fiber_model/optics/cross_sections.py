"""Cross-sections of textile fibers as outlines of arcs: circle, ellipse, lobed, kidney, triangle, polygon."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from weft.files.errors import InputError

from .config import (
    CircleConfig,
    CrossSectionConfig,
    EllipseConfig,
    KidneyConfig,
    LobedConfig,
    PolygonConfig,
    RoundedTriangleConfig,
)
from .outline import Array, Outline, outline_of_polygon, outline_of_rounded_polygon, outline_through

Curve = Callable[[Array], Array]
"""Points of a closed curve [..., 2] for a parameter from 0 to 2 pi, counterclockwise."""

CIRCLE_POINTS, ELLIPSE_POINTS, KIDNEY_POINTS, POINTS_PER_LOBE = 4, 24, 28, 8
"""Each point begins two arcs."""


def build_outline(config: CrossSectionConfig) -> Outline:
    """Raises `InputError` for a polygon that crosses itself or has no area."""
    match config:
        case CircleConfig():
            return circle(config.radius_mm)
        case EllipseConfig():
            return ellipse(*config.semi_axes_mm)
        case LobedConfig():
            return lobed(config.radius_mm, config.lobes, config.depth, config.flatness)
        case KidneyConfig():
            return kidney(config.width_mm, config.thickness_mm, np.radians(config.bend_deg))
        case RoundedTriangleConfig():
            return rounded_triangle(config.side_mm, config.corner_radius_mm)
        case PolygonConfig():
            return polygon(np.array(config.vertices_mm, dtype=np.float64))


def circle(radius: float) -> Outline:
    """Exactly round: a biarc between points of a circle is that circle."""
    return ellipse(radius, radius, points=CIRCLE_POINTS)


def ellipse(a: float, b: float, *, points: int = ELLIPSE_POINTS) -> Outline:
    t = np.arange(points) * 2 * np.pi / points
    places = np.stack([a * np.cos(t), b * np.sin(t)], axis=1)
    return outline_through(places, np.stack([-a * np.sin(t), b * np.cos(t)], axis=1))


def lobed(radius: float, lobes: int, depth: float, flatness: float = 1.0) -> Outline:
    """r = radius (1 + depth cos(lobes phi)), then y scaled by `flatness`."""

    def place(t: Array) -> Array:
        r = radius * (1 + depth * np.cos(lobes * t))
        return np.stack([r * np.cos(t), flatness * r * np.sin(t)], axis=-1)

    return _outline_of_curve(place, max(POINTS_PER_LOBE * lobes, ELLIPSE_POINTS))


def kidney(width: float, thickness: float, bend: float) -> Outline:
    """An ellipse whose long axis is an arc that turns by `bend` [rad]; its box is centered in the origin."""
    midline_radius = width / bend

    def place(t: Array) -> Array:
        angle = 0.5 * bend * np.cos(t)
        r = midline_radius + 0.5 * thickness * np.sin(t)
        return np.stack([r * np.sin(angle), r * np.cos(angle)], axis=-1)

    points = KIDNEY_POINTS
    outline = _outline_of_curve(place, points)
    middle = 0.5 * (outline.points().min(axis=0) + outline.points().max(axis=0))
    return Outline(
        outline.starts - middle,
        outline.start_tangents,
        outline.ends - middle,
        outline.end_tangents,
        outline.curvatures,
    )


def rounded_triangle(side: float, corner_radius: float) -> Outline:
    angle = np.pi / 2 + np.arange(3) * 2 * np.pi / 3
    corners = side / np.sqrt(3.0) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return outline_of_rounded_polygon(corners, corner_radius)


def polygon(vertices: Array) -> Outline:
    """Straight sides through `vertices` [N, 2], the middle of their box moved to the origin."""
    vertices = vertices - 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    if (np.linalg.norm(np.roll(vertices, -1, axis=0) - vertices, axis=1) < 1e-9).any():
        raise InputError("cross_section.vertices_mm: two corners in a row are the same point")
    if _crosses_itself(vertices):
        raise InputError("cross_section.vertices_mm: the sides cross or touch; a simple polygon is needed")
    return outline_of_polygon(vertices)


def _outline_of_curve(place: Curve, points: int) -> Outline:
    """Points evenly spaced in the parameter, tangents by central differences (exact to 1e-10)."""
    t = np.arange(points) * 2 * np.pi / points
    step = 1e-5
    return outline_through(place(t), place(t + step) - place(t - step))


def _crosses_itself(vertices: Array) -> bool:
    """Whether any two sides that are not neighbors meet, or neighbors fold back on each other."""
    starts, ends = vertices, np.roll(vertices, -1, axis=0)
    count = len(vertices)
    i, j = np.triu_indices(count, k=1)
    apart = (j - i > 1) & ~((i == 0) & (j == count - 1))
    i, j = i[apart], j[apart]
    from_i = _side(starts[i], ends[i], starts[j]) * _side(starts[i], ends[i], ends[j])
    from_j = _side(starts[j], ends[j], starts[i]) * _side(starts[j], ends[j], ends[i])
    near = _boxes_meet(starts[i], ends[i], starts[j], ends[j])
    if (near & (from_i <= 0) & (from_j <= 0)).any():
        return True
    along, after = ends - starts, np.roll(ends - starts, -1, axis=0)
    turn = along[:, 0] * after[:, 1] - along[:, 1] * after[:, 0]
    return bool(((turn == 0) & ((along * after).sum(axis=1) < 0)).any())


def _boxes_meet(a: Array, b: Array, c: Array, d: Array) -> NDArray[np.bool_]:
    apart = (np.maximum(a, b) < np.minimum(c, d)) | (np.maximum(c, d) < np.minimum(a, b))
    return np.asarray(~apart.any(axis=1))


def _side(a: Array, b: Array, p: Array) -> Array:
    """The sign says on which side of the line a b the point p lies."""
    return (b[:, 0] - a[:, 0]) * (p[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (p[:, 0] - a[:, 0])
