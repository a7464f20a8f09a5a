"""Round bars and bent wire without a file: a rail for a scarf, a hanger for a shirt."""

from __future__ import annotations

import numpy as np

from .mesh import Triangles
from .surface_config import TubeSurface

SIDES = 24
"""Of the polygon around the tube; its normals are those of the round."""


def tube_triangles(surface: TubeSurface, material: int) -> Triangles:
    """In the scene [mm]: rings at the points, mitered, with flat ends."""
    points = np.array(surface.points_mm)
    rings, normals = _rings(points, surface.radius_mm)
    corners, corner_normals = [_quads(values) for values in (rings, normals)]
    for end, inward in ((0, 1), (-1, -2)):
        outward = points[end] - points[inward]
        outward /= np.linalg.norm(outward)
        middle, ring = np.broadcast_to(points[end], rings[end].shape), rings[end]
        cap = np.stack([middle, ring, np.roll(ring, -1, axis=0)], axis=1)
        corners = np.concatenate([corners, cap if end else cap[:, ::-1]])
        corner_normals = np.concatenate([corner_normals, np.broadcast_to(outward, cap.shape)])
    count = len(corners)
    zero = np.zeros(count, int)
    return Triangles(corners, corner_normals, np.zeros((count, 3, 2)), np.full(count, material), zero)


def _rings(points: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Places and normals of all rings, [ring, SIDES, 3]; at bends in the plane that halves them."""
    legs = np.diff(points, axis=0)
    legs /= np.linalg.norm(legs, axis=1, keepdims=True)
    side = np.cross(legs[0], np.eye(3)[np.argmin(np.abs(legs[0]))])
    side /= np.linalg.norm(side)
    angle = 2 * np.pi * np.arange(SIDES) / SIDES
    rings, normals = [], []
    for i, point in enumerate(points):
        before, after = legs[max(i - 1, 0)], legs[min(i, len(legs) - 1)]
        # carried along without twist, as far as the bend lets it
        side = side - (side @ before) * before
        side /= np.linalg.norm(side)
        around = np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * np.cross(before, side)
        middle = before + after
        reach = -(around @ middle) / (before @ middle)
        rings.append(point + radius * (around + reach[:, None] * before))
        normals.append(around - np.outer(around @ middle / (middle @ middle), middle))
        normals[-1] /= np.linalg.norm(normals[-1], axis=1, keepdims=True)
    return np.array(rings), np.array(normals)


def _quads(values: np.ndarray) -> np.ndarray:
    """Values at the corners of the triangles between neighboring rings, shape [n, 3, 3]."""
    a, b = values[:-1], values[1:]
    c, d = np.roll(b, -1, axis=1), np.roll(a, -1, axis=1)
    return np.concatenate([np.stack([a, d, b], axis=2), np.stack([d, c, b], axis=2)]).reshape(-1, 3, 3)
