"""Material frames of simulated yarns (discrete elastic rods, Bergou et al. 2008) as twist against our frames.

A simulation stores where the yarn's material has turned to as a director on every edge. `YarnSet.twist`
stores the same as an angle against the rotation-minimizing frame, which does not depend on how the
simulation carried its directors.
"""

from __future__ import annotations

import numpy as np

from .catmull_rom import PIECES, CatmullRom, dot, norm
from .frames import rotation_minimizing_angle, turn_reference
from .yarns import YarnSet


def material_twist(yarns: YarnSet, director: np.ndarray) -> np.ndarray:
    """Angle [rad] of the material directors, shape [point_count, 3], against the frames of `yarns`.

    Directors lie at the control points and need not be exactly perpendicular to the curve. The angle is
    continuous along each yarn; frames turned by it pass through the directors at the control points.
    """
    curves = CatmullRom.through(yarns)
    tangent, angle = _frames_at_knots(curves, yarns.closed)
    at_points = _knot_of_point(yarns, curves)
    tangent = tangent[at_points]
    normal = turn_reference(tangent, angle[at_points])
    flat = director - dot(director, tangent)[:, None] * tangent
    twist = np.arctan2(dot(np.cross(tangent, normal), flat), dot(normal, flat))
    for begin, end in zip(yarns.offsets[:-1], yarns.offsets[1:], strict=True):
        twist[begin:end] = np.unwrap(twist[begin:end])
    return twist


def edge_directors_at_points(
    reference: np.ndarray, edge: np.ndarray, angle: np.ndarray, previous: np.ndarray
) -> np.ndarray:
    """Material director at each vertex from those of its two edges, shape [n, 3].

    `reference` is the reference director of the edge that leaves each vertex, `edge` that edge's vector and
    `angle` [rad] the material's angle there; `previous` is the vertex before, or the vertex itself where
    there is none.
    """
    axis = edge / norm(edge)[:, None]
    turned = np.cos(angle)[:, None] * reference + np.sin(angle)[:, None] * np.cross(axis, reference)
    return turned + turned[previous]


def _frames_at_knots(curves: CatmullRom, closed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tangent and rotation-minimizing angle at every knot of the arc length."""
    knots, offsets = curves.knots(), curves.knot_offsets
    yarn = np.repeat(np.arange(len(closed)), np.diff(offsets))
    piece = np.arange(offsets[-1]) - yarn
    is_end = np.zeros(len(piece), bool)
    is_end[offsets[1:] - 1] = True
    segment = (piece - is_end) // PIECES
    u = np.where(is_end, 1.0, (piece % PIECES) / PIECES)
    velocity = curves.derivative(segment, u)
    tangent = velocity / np.maximum(norm(velocity), 1e-300)[:, None]
    angle = rotation_minimizing_angle(curves.position(segment, u), tangent, offsets)
    for loop in np.flatnonzero(closed):
        part = slice(offsets[loop], offsets[loop + 1])
        excess = (angle[part][-1] + np.pi) % (2 * np.pi) - np.pi
        angle[part] -= excess * knots[part] / knots[part][-1]
    return tangent, angle


def _knot_of_point(yarns: YarnSet, curves: CatmullRom) -> np.ndarray:
    """Index of the knot at each control point."""
    counts = yarns.point_counts
    yarn = np.repeat(np.arange(yarns.yarn_count), counts)
    local = np.arange(yarns.point_count) - yarns.offsets[yarn]
    return curves.knot_offsets[yarn] + local * PIECES
