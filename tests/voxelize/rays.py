"""Rays through fibers and through their grid: what is hit, and what the grid says would be."""

from __future__ import annotations

import math

import numpy as np

from weft.voxelize.grid import FiberGrid

STEPS_PER_VOXEL = 6.0
"""Samples of the grid along a ray; what a sample stands for at a voxel's face averages out."""


def random_rays(low: np.ndarray, high: np.ndarray, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Lines through random points of a box in random directions: points and unit directions, [count, 3]."""
    rng = np.random.default_rng(seed)
    w = rng.normal(size=(count, 3))
    return rng.uniform(low, high, (count, 3)), w / np.linalg.norm(w, axis=1, keepdims=True)


def fibers_hit(segments: np.ndarray, radius: float, points: np.ndarray, w: np.ndarray) -> np.ndarray:
    """How many segments each line passes within `radius` of their axes, beside the segment: int [ray]."""
    a = segments[:, 0].astype(np.float64)
    d = segments[:, 1].astype(np.float64) - a
    length = np.linalg.norm(d, axis=1)
    t = d / length[:, None]
    hits = np.zeros(len(points), dtype=np.int64)
    for ray, (point, direction) in enumerate(zip(points, w, strict=True)):
        from_a = point - a
        along = t @ direction
        # closest approach of two lines: at u on the fiber's axis
        crossed = 1 - along**2
        on_t, on_w = np.einsum("ij,ij->i", from_a, t), from_a @ direction
        u = (on_t - along * on_w) / np.maximum(crossed, 1e-12)
        gap = from_a - u[:, None] * t
        gap -= (gap @ direction)[:, None] * direction
        near = (np.einsum("ij,ij->i", gap, gap) < radius**2) & (u >= 0) & (u < length)
        hits[ray] = np.count_nonzero(near)
    return hits


def optical_depth(
    grid: FiberGrid, points: np.ndarray, w: np.ndarray, reach: float, *, by_moment: bool
) -> np.ndarray:
    """sigma_t integrated along each line from -reach to reach around its point [ray]."""
    place = {tuple(origin): i for i, origin in enumerate((grid.origins // 8).tolist())}
    corner, last = grid.origins.min(axis=0) // 8, grid.origins.max(axis=0) // 8
    table = np.full(last - corner + 1, -1)
    for origin, i in place.items():
        table[tuple(np.array(origin) - corner)] = i
    h = grid.voxel_size_mm
    steps = math.ceil(2 * reach / h * STEPS_PER_VOXEL)
    s = (np.arange(steps) + 0.5) / steps * 2 * reach - reach
    depths = np.empty(len(points))
    for ray, (point, direction) in enumerate(zip(points, w, strict=True)):
        voxel = np.floor((point + s[:, None] * direction) / h).astype(np.int64)
        brick = voxel // 8 - corner
        inside = ((brick >= 0) & (brick < table.shape)).all(axis=1)
        row = table[tuple(brick[inside].T)]
        local = (voxel[inside] % 8) @ np.array([64, 8, 1])
        row, local = row[row >= 0], local[row >= 0]
        density = grid.density[row, local].astype(np.float64)
        if by_moment:
            assert grid.moment_diag is not None
            assert grid.moment_off is not None
            pairs = direction[[0, 0, 1]] * direction[[1, 2, 2]]
            along = grid.moment_diag[row, local] @ direction**2 + 2 * grid.moment_off[row, local] @ pairs
        else:
            along = (grid.direction[row, local] @ direction) ** 2
        sine = np.sqrt(np.clip(1 - along, 0, 1))
        depths[ray] = (2 * density / (math.pi * grid.fiber_radius_mm) * sine).sum() * (2 * reach / steps)
    return depths
