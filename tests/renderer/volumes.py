"""Small volumes with known content, and what theory says about them."""

from __future__ import annotations

import math

import numpy as np

from weft.voxelize.grid import FiberGrid, FiberVolume

RADIUS_MM = 0.01
VOXEL_MM = 0.05


def brick_origins(shape: tuple[int, int, int], start: tuple[int, int, int] = (0, 0, 0)) -> np.ndarray:
    """First voxels of a block of bricks, int32, sorted."""
    places = np.array(list(np.ndindex(shape)), np.int32) + np.array(start, np.int32)
    return places * 8


def uniform_grid(
    shape: tuple[int, int, int],
    density: float,
    axis: tuple[float, float, float],
    *,
    radius: float = RADIUS_MM,
) -> FiberGrid:
    """A block of bricks filled evenly with parallel fibers."""
    origins = brick_origins(shape)
    direction = np.broadcast_to(np.float32(axis) / np.linalg.norm(axis), (len(origins), 512, 3))
    return FiberGrid(
        voxel_size_mm=VOXEL_MM,
        fiber_radius_mm=radius,
        origins=origins,
        density=np.full((len(origins), 512), density, np.float32),
        direction=np.ascontiguousarray(direction, np.float32),
    )


def random_grid(
    shape: tuple[int, int, int], *, seed: int, fill: float = 0.3, peak: float = 0.2, brick_fill: float = 1.0
) -> FiberGrid:
    """Random densities in a part of the voxels, random axes; some bricks missing."""
    rng = np.random.default_rng(seed)
    origins = brick_origins(shape)
    origins = origins[rng.random(len(origins)) < brick_fill]
    count = len(origins)
    density = (
        rng.random((count, 512)) ** 3 * peak * rng.random((count, 1)) * (rng.random((count, 512)) < fill)
    )
    axis = rng.normal(size=(count, 512, 3))
    axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    axis = np.where(density[..., None] > 0, axis, 0)
    return FiberGrid(VOXEL_MM, RADIUS_MM, origins, density.astype(np.float32), axis.astype(np.float32))


def volume(*grids: FiberGrid) -> FiberVolume:
    """Media named a, b, c, ..."""
    return FiberVolume({chr(ord("a") + i): grid for i, grid in enumerate(grids)})


def projected_extinction(density: float, cosine: float, radius: float = RADIUS_MM) -> float:
    """(2 phi / (pi a)) sin of the angle between ray and fiber [1/mm]."""
    return 2 * density / (math.pi * radius) * math.sqrt(1 - cosine**2)


def exact_optical_depth(grid: FiberGrid, origins_mm: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Optical depth of rays from their origins on, from the stored values, in float64."""
    pieces = ray_pieces(grid, origins_mm, directions)
    return np.array([(sigma * np.diff(t)).sum() for t, sigma in pieces])


def ray_pieces(
    grid: FiberGrid, origins_mm: np.ndarray, directions: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Per ray the distances [mm] at which it crosses any voxel plane, and the extinction between [1/mm]."""
    cells = grid.origins // 8
    low, high = cells.min(axis=0), cells.max(axis=0) + 1
    size = (high - low) * 8
    density, axis = np.zeros(size), np.zeros((*size, 3))
    for place, values, axes in zip((cells - low) * 8, grid.density, grid.direction, strict=True):
        box = tuple(slice(p, p + 8) for p in place)
        density[box], axis[box] = values.reshape(8, 8, 8), axes.reshape(8, 8, 8, 3)
    pieces = []
    for origin, direction in zip(origins_mm / grid.voxel_size_mm - low * 8, directions, strict=True):
        planes = [(np.arange(size[k] + 1) - origin[k]) / direction[k] for k in range(3)]
        entry = max(0.0, *(p.min() for p in planes))
        leave = min(p.max() for p in planes)
        t = np.sort(np.clip(np.concatenate(planes), entry, max(entry, leave)))
        middle = origin + direction * (0.5 * (t[1:] + t[:-1]))[:, None]
        i, j, k = np.clip(middle.astype(int), 0, size - 1).T
        cosine = axis[i, j, k] @ direction
        sigma = 2 * density[i, j, k] / (np.pi * grid.fiber_radius_mm) * np.sqrt(np.maximum(1 - cosine**2, 0))
        pieces.append((t * grid.voxel_size_mm, sigma))
    return pieces
