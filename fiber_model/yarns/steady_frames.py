"""Frames of yarns that move: their first normal follows the yarn as it lies at rest, so that no fiber jumps.

The first normal of a yarn is otherwise chosen by its first tangent alone, among three axes; where a tangent
turns past the middle between two of them, all fibers would turn about their yarn from one frame to the next.
Here it is the normal at rest, turned as the yarn's points have been turned (best rotation: Kabsch 1976).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from weft.files.errors import InputError

from .catmull_rom import CatmullRom, dot, norm
from .frames import reference_normal
from .yarns import YarnSet

STRAIGHT = 1e-6
"""A yarn whose extent across is below this part of its extent along has no rotation about itself to see."""


def follow_rest(yarns: YarnSet, rest: YarnSet) -> YarnSet:
    """The yarns with a constant `twist` per yarn that keeps their normals with their material.

    A yarn that simulates its own twist keeps that. Raises `InputError` unless `rest` has the same points.
    """
    if not np.array_equal(yarns.offsets, rest.offsets):
        raise InputError(
            f"yarns.rest: {rest.yarn_count} yarns of {rest.point_count} points, and "
            f"{yarns.yarn_count} of {yarns.point_count} in this frame; both must have the same."
        )
    if yarns.twist is not None:
        return yarns
    tangent, before = _first_tangents(yarns), _first_tangents(rest)
    reference = reference_normal(tangent)
    turned = np.array(
        [
            _turned(yarns.points[a:b], rest.points[a:b], t0, t1) @ normal
            for a, b, t0, t1, normal in zip(
                yarns.offsets, yarns.offsets[1:], before, tangent, reference_normal(before), strict=False
            )
        ]
    )
    angle = np.arctan2(dot(np.cross(tangent, reference), turned), dot(reference, turned))
    return replace(yarns, twist=np.repeat(angle, yarns.point_counts))


def _turned(points: np.ndarray, rest: np.ndarray, before: np.ndarray, tangent: np.ndarray) -> np.ndarray:
    """Rotation of a yarn's beginning since it lay at rest, shape [3, 3]."""
    centered, at_rest = points - points.mean(axis=0), rest - rest.mean(axis=0)
    u, size, v = np.linalg.svd(at_rest.T @ centered)
    rotation = np.eye(3)
    if size[1] > STRAIGHT**2 * size[0]:
        rotation = v.T @ np.diag([1.0, 1.0, np.sign(np.linalg.det(v.T @ u.T))]) @ u.T
    return smallest_rotation(rotation @ before, tangent) @ rotation


def smallest_rotation(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """The rotation about the common perpendicular that takes one unit vector to another, shape [3, 3]."""
    cosine = float(start @ end)
    if cosine < -1 + 1e-9:
        axis = reference_normal(start[None])[0]
        return 2 * np.outer(axis, axis) - np.eye(3)
    x, y, z = np.cross(start, end)
    across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + across + across @ across / (1 + cosine)


def _first_tangents(yarns: YarnSet) -> np.ndarray:
    """Unit tangent where each yarn begins, shape [yarn_count, 3]."""
    segments = np.where(yarns.closed, yarns.point_counts, yarns.point_counts - 1)
    first = np.cumsum(segments) - segments
    velocity = CatmullRom.through(yarns).derivative(first, np.zeros(len(first)))
    return velocity / np.maximum(norm(velocity), 1e-300)[:, None]
