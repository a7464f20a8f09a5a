"""The accumulators of one tile at a time, and the bricks that come out of them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import warp as wp

from .grid import BRICK_SIZE, BRICK_VOXELS, CHANNELS, MOMENTS, empty_values
from .kernels import LENGTH_UNITS, SUM_COUNT, TileSums, resolve_bricks
from .tiles import VoxelBox

DEVICE = "cpu"


def accumulator_bytes(tile_voxels: int) -> int:
    """Memory of one accumulator once all its bricks have been touched."""
    return (tile_voxels // BRICK_SIZE) ** 3 * BRICK_VOXELS * SUM_COUNT * 8


@dataclass(frozen=True)
class BrickBatch:
    """The occupied bricks of one tile, sorted by (x, y, z); fields as in `FiberGrid`."""

    origins: np.ndarray
    density: np.ndarray
    direction: np.ndarray
    moment_diag: np.ndarray | None = None
    moment_off: np.ndarray | None = None

    @property
    def channels(self) -> dict[str, np.ndarray]:
        """The arrays that stand for each voxel, as `FiberGrid.channels`."""
        held = {name: getattr(self, name) for name in CHANNELS}
        return {name: array for name, array in held.items() if array is not None}


class TileAccumulator:
    """Sums for all voxels of one tile, used for tile after tile by one worker."""

    def __init__(self, tile_voxels: int, voxel_size_mm: float, *, second_moment: bool = False) -> None:
        self._bricks_per_side = tile_voxels // BRICK_SIZE
        self._tile_voxels = tile_voxels
        self._voxel_size_mm = voxel_size_mm
        self._second_moment = second_moment
        # fresh zero pages cost nothing until fibers reach their brick
        self._sums = _shared(np.zeros(accumulator_bytes(tile_voxels) // 8, dtype=np.int64), wp.int64)
        self._used = _shared(np.zeros(self._bricks_per_side**3, dtype=np.uint8), wp.uint8)

    def open(self, origin: np.ndarray, region: VoxelBox, lines: np.ndarray) -> TileSums:
        """The tile that begins at voxel `origin`, cut to the region; `lines` as in `TilePlan`."""
        tile = TileSums()
        tile.origin = wp.vec3i(*origin.tolist())
        tile.low = wp.vec3i(*np.maximum(origin, region.low).tolist())
        tile.high = wp.vec3i(*np.minimum(origin + self._tile_voxels, region.high).tolist())
        tile.bricks_per_side = self._bricks_per_side
        tile.inverse_voxel_size = 1.0 / self._voxel_size_mm
        tile.sums = self._sums
        tile.used = self._used
        tile.offsets = _shared(lines, wp.vec2)
        return tile

    def resolve(self, origin: np.ndarray, fiber_radius_mm: float) -> BrickBatch:
        """The tile's occupied bricks; its sums are clear afterwards."""
        used = self._used.numpy()
        bricks = np.flatnonzero(used).astype(np.int32)
        used[bricks] = 0
        density, direction = empty_values(len(bricks), "density"), empty_values(len(bricks), "direction")
        moments = [empty_values(len(bricks) if self._second_moment else 0, name) for name in MOMENTS]
        wp.launch(
            resolve_bricks,
            dim=density.shape,
            inputs=[
                self._sums,
                _shared(bricks, wp.int32),
                # phi = pi a^2 lambda, with lambda h^3 the length in the voxel
                math.pi * fiber_radius_mm**2 / (self._voxel_size_mm**2 * LENGTH_UNITS),
            ],
            outputs=[
                _shared(density, wp.float32),
                *(_shared(array, wp.vec3) for array in (direction, *moments)),
            ],
            device=DEVICE,
        )
        side = self._bricks_per_side
        place = np.stack(np.unravel_index(bricks, (side, side, side)), axis=1)
        origins = (origin + place * BRICK_SIZE).astype(np.int32)
        return BrickBatch(origins, density, direction, *(moments if self._second_moment else ()))


def _shared(array: np.ndarray, dtype: type) -> wp.array:
    """A Warp array on the memory of a numpy array."""
    return wp.array(array, dtype=dtype, device=DEVICE, copy=False)
