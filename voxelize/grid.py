"""The sparse grid of one medium, in bricks of 8 x 8 x 8 voxels, as it lies in memory and in .vdb files."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

BRICK_SIZE = 8
BRICK_VOXELS = BRICK_SIZE**3


@dataclass(frozen=True)
class FiberGrid:
    """Fiber volume fraction and direction in the occupied bricks of one medium.

    Voxel (i, j, k) covers [i, i+1] x [j, j+1] x [k, k+1] times the voxel size, in mm. Within a brick the voxel
    with local coordinates (x, y, z) has index (x * 8 + y) * 8 + z, as in an OpenVDB leaf.
    """

    voxel_size_mm: float
    fiber_radius_mm: float
    origins: np.ndarray
    """First voxel of each brick, multiples of 8, int32, shape [brick_count, 3], sorted by (x, y, z)."""
    density: np.ndarray
    """Fiber volume fraction [1], float32, shape [brick_count, 512]; may pass 1 where fibers overlap."""
    direction: np.ndarray
    """Unit fiber axis, float32, shape [brick_count, 512, 3]; zero where the density is zero."""
