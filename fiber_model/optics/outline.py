"""The outline of a fiber's cross-section: straight lines and circular arcs, end to end, counterclockwise.

Arcs with continuous tangents (biarcs, Bolton 1975, "Biarc curves", Computer-Aided Design 7(2)) are a shape of
their own: rays meet them exactly, and their normals are those of the surface that is hit, so that energy and
reciprocity hold to rounding. A polygon with interpolated normals would have neither.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SUPPORT_ANGLES = 720
_POINTS_PER_ARC = 33


@dataclass(frozen=True)
class Outline:
    """N arcs [mm], each below half a turn; curvature 0 is a line, below 0 a dent. Arrays [N, 2], [N]."""

    starts: Array
    start_tangents: Array
    """Unit vectors along the outline; the inside lies to their left."""
    ends: Array
    end_tangents: Array
    curvatures: Array
    """[1/mm]"""

    def __len__(self) -> int:
        return len(self.curvatures)

    @property
    def arc_lengths(self) -> Array:
        chords = np.linalg.norm(self.ends - self.starts, axis=1)
        half = np.arcsin(np.clip(0.5 * chords * np.abs(self.curvatures), 0.0, 1.0))
        return chords / np.sinc(half / np.pi)

    @property
    def perimeter(self) -> float:
        """[mm]"""
        return float(self.arc_lengths.sum())

    @property
    def area(self) -> float:
        """[mm²], of the polygon through the joints and of the segment between each chord and its arc."""
        (x0, y0), (x1, y1) = self.starts.T, self.ends.T
        turn = self.arc_lengths * self.curvatures
        # (turn - sin turn) / (2 k²), by its series where the turn is small
        small = np.abs(turn) < 1e-3
        k = np.where(small, 1.0, self.curvatures)
        segment = np.where(
            small, self.arc_lengths**3 * self.curvatures / 12, (turn - np.sin(turn)) / (2 * k**2)
        )
        return float((0.5 * (x0 * y1 - x1 * y0) + segment).sum())

    @property
    def bounding_radius(self) -> float:
        """Of a circle around the origin that holds every arc [mm]."""
        return float(np.linalg.norm(self.points(), axis=1).max()) * (1 + 1e-3)

    @property
    def mean_width(self) -> float:
        """Projected width, averaged over all rotations [mm]: the perimeter of the hull over pi."""
        angle = np.arange(_SUPPORT_ANGLES) * 2 * np.pi / _SUPPORT_ANGLES
        support = (self.points() @ np.stack([np.cos(angle), np.sin(angle)])).max(axis=0)
        return float(2 * support.mean())

    @property
    def convex(self) -> bool:
        turns = _cross(self.end_tangents, np.roll(self.start_tangents, -1, axis=0))
        return bool((self.curvatures * self.arc_lengths > -1e-9).all() and (turns > -1e-9).all())

    def points(self, per_arc: int = _POINTS_PER_ARC) -> Array:
        """Points along the outline, shape [N * (per_arc - 1), 2]."""
        length = self.arc_lengths[:, None] * np.linspace(0, 1, per_arc)[:-1]
        turn = length * self.curvatures[:, None]
        chord = length * np.sinc(turn / (2 * np.pi))
        along, aside = chord * np.cos(turn / 2), chord * np.sin(turn / 2)
        tangents = self.start_tangents[:, None]
        places = (
            self.starts[:, None] + along[..., None] * tangents + aside[..., None] * _left_normals(tangents)
        )
        return places.reshape(-1, 2)


def outline_of_polygon(vertices: Array) -> Outline:
    """Straight lines through `vertices` [N, 2], in order; turned counterclockwise where needed."""
    if _polygon_area(vertices) < 0:
        vertices = vertices[::-1]
    ends = np.roll(vertices, -1, axis=0)
    tangents = ends - vertices
    tangents = tangents / np.linalg.norm(tangents, axis=1, keepdims=True)
    return Outline(vertices, tangents, ends, tangents, np.zeros(len(vertices)))


def outline_through(points: Array, tangents: Array) -> Outline:
    """Two arcs between each point and the next, tangents [N, 2] continuous everywhere; a closed curve."""
    tangents = tangents / np.linalg.norm(tangents, axis=1, keepdims=True)
    if _polygon_area(points) < 0:
        points, tangents = points[::-1], -tangents[::-1]
    next_points, next_tangents = np.roll(points, -1, axis=0), np.roll(tangents, -1, axis=0)
    middles = _biarc_middles(points, tangents, next_points, next_tangents)
    first = _arcs(points, tangents, middles)
    second = _arcs(middles, first.end_tangents, next_points)
    return _interleave(first, second)


def outline_of_rounded_polygon(vertices: Array, corner_radius: float) -> Outline:
    """A convex polygon, counterclockwise [N, 2], its corners replaced by arcs of one radius [mm]."""
    sides = outline_of_polygon(vertices)
    before = np.roll(sides.start_tangents, 1, axis=0)
    turn = np.arctan2(
        _cross(before, sides.start_tangents), np.einsum("ij,ij->i", before, sides.start_tangents)
    )
    cut = corner_radius * np.tan(turn / 2)[:, None]
    corner_starts = sides.starts - cut * before
    corner_ends = sides.starts + cut * sides.start_tangents
    corners = _arcs(corner_starts, before, corner_ends)
    lines = _arcs(corner_ends, sides.start_tangents, np.roll(corner_starts, -1, axis=0))
    return _interleave(corners, lines)


def _biarc_middles(p0: Array, t0: Array, p1: Array, t1: Array) -> Array:
    """Where the two arcs of a biarc meet, with control polygons of equal length on both sides."""
    chord, both = p1 - p0, t0 + t1
    square = np.einsum("ij,ij->i", chord, chord)
    along = np.einsum("ij,ij->i", chord, both)
    spread = 2 * (1 - np.einsum("ij,ij->i", t0, t1))
    reach = (square / (along + np.sqrt(along**2 + spread * square)))[:, None]
    return 0.5 * (p0 + p1 + reach * (t0 - t1))


def _arcs(starts: Array, tangents: Array, ends: Array) -> Outline:
    """The arc from each start along its tangent to each end."""
    chords = ends - starts
    squares = np.einsum("ij,ij->i", chords, chords)
    curvatures = 2 * np.einsum("ij,ij->i", chords, _left_normals(tangents)) / squares
    along = np.einsum("ij,ij->i", chords, tangents)[:, None] / squares[:, None]
    end_tangents = 2 * along * chords - tangents
    return Outline(starts, tangents, ends, end_tangents, curvatures)


def _interleave(first: Outline, second: Outline) -> Outline:
    names = ("starts", "start_tangents", "ends", "end_tangents", "curvatures")
    pairs = [np.stack([getattr(first, name), getattr(second, name)], axis=1) for name in names]
    merged = [pair.reshape(-1, *pair.shape[2:]) for pair in pairs]
    keep = np.linalg.norm(merged[2] - merged[0], axis=1) > 0
    return Outline(*(array[keep] for array in merged))


def _left_normals(tangents: Array) -> Array:
    return np.stack([-tangents[..., 1], tangents[..., 0]], axis=-1)


def _cross(a: Array, b: Array) -> Array:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _polygon_area(vertices: Array) -> float:
    return float(0.5 * _cross(vertices, np.roll(vertices, -1, axis=0)).sum())
