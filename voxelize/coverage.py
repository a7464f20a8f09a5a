"""How a fiber fills voxels that are not large against it: by lines spread evenly over its cross-section.

Each segment stands for K parallel lines, each with 1/K of its length: the length is kept exactly, and a voxel
receives the part of the cylinder's volume that lies in it. Lines lie on rings of equal area per line, at the
radius that keeps the second moment of the disc. In voxels of four radii and more one line is enough; between
four and two radii the lines draw apart smoothly.
"""

from __future__ import annotations

import math

import numpy as np

LINE_FROM = 4.0
"""Voxel size, in fiber radii, from which on a fiber is one line."""
FULL_BELOW = 2.0
"""Voxel size, in fiber radii, below which its lines fill the whole cross-section."""
RINGS = 6.0
"""Rings for each voxel size in the radius that the lines are spread over."""
MAX_RINGS = 12


def spread(voxel_size_mm: float, fiber_radius_mm: float) -> float:
    """Which part of its radius a fiber's lines are spread over: 0 is one line, 1 the whole cross-section."""
    t = (LINE_FROM - voxel_size_mm / fiber_radius_mm) / (LINE_FROM - FULL_BELOW)
    t = min(max(t, 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


def line_offsets(voxel_size_mm: float, fiber_radius_mm: float) -> np.ndarray:
    """Where the lines pierce the cross-section [mm], float32, shape [line_count, 2]."""
    part = spread(voxel_size_mm, fiber_radius_mm)
    if part == 0.0:
        return np.zeros((1, 2), dtype=np.float32)
    rings = min(math.ceil(RINGS * part * fiber_radius_mm / voxel_size_mm), MAX_RINGS)
    count = 1 + 3 * rings * (rings + 1)
    points = [np.zeros((1, 2))]
    for ring in range(1, rings + 1):
        inner, outer = (1 + 3 * (ring - 1) * ring) / count, (1 + 3 * ring * (ring + 1)) / count
        angle = (np.arange(6 * ring) + 0.5 * (ring % 2)) * (2 * math.pi / (6 * ring))
        radius = math.sqrt(0.5 * (inner + outer))
        points.append(radius * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    return (part * fiber_radius_mm * np.concatenate(points)).astype(np.float32)
