"""The accumulators of one tile at a time, and the bricks that come out of them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .grid import BRICK_SIZE, CHANNELS, MOMENTS, OPTIONAL, empty_values
from .native_tiles import NativeTileSums, has_native_tiles
from .tile_sums import SUM_BYTES, OpenTile, TilePlace, TileSums, units_per_voxel
from .tiles import VoxelBox


def accumulator_bytes(tile_voxels: int) -> int:
    """Memory of one accumulator once all its bricks have been touched."""
    return tile_voxels**3 * SUM_BYTES


def load_kernels() -> None:
    """Make Warp's kernels ready, where they are needed, before threads ask for them."""
    if not has_native_tiles():
        from .warp_tiles import load_kernels as load

        load()


@dataclass(frozen=True)
class BrickBatch:
    """The occupied bricks of one tile, sorted by (x, y, z); fields as in `FiberGrid`."""

    origins: np.ndarray
    density: np.ndarray
    direction: np.ndarray
    moment_diag: np.ndarray | None = None
    moment_off: np.ndarray | None = None
    albedo: np.ndarray | None = None

    @property
    def channels(self) -> dict[str, np.ndarray]:
        """The arrays that stand for each voxel, as `FiberGrid.channels`."""
        held = {name: getattr(self, name) for name in CHANNELS}
        return {name: array for name, array in held.items() if array is not None}


class TileAccumulator:
    """Sums for all voxels of one tile, used for tile after tile by one worker.

    `native=False` takes Warp's kernels where the C++ twin is there too; the bits are the same.
    """

    def __init__(
        self,
        tile_voxels: int,
        voxel_size_mm: float,
        *,
        second_moment: bool = False,
        native: bool | None = None,
    ) -> None:
        bricks_per_side = tile_voxels // BRICK_SIZE
        self._shape = (bricks_per_side,) * 3
        self._tile_voxels = tile_voxels
        self._voxel_size_mm = voxel_size_mm
        self._second_moment = second_moment
        self._units = units_per_voxel(1)
        self._sums: TileSums
        if native is False or not has_native_tiles():
            from .warp_tiles import WarpTileSums

            self._sums = WarpTileSums(bricks_per_side)
        else:
            self._sums = NativeTileSums(bricks_per_side)

    def place(self, origin: np.ndarray, region: VoxelBox, lines: np.ndarray) -> TilePlace:
        """Of the tile that begins at voxel `origin`, cut to the region; `lines` as in `TilePlan`."""
        return TilePlace(
            origin=origin,
            low=np.maximum(origin, region.low),
            high=np.minimum(origin + self._tile_voxels, region.high),
            voxel_size_mm=self._voxel_size_mm,
            lines=lines,
            region_mm=np.stack([region.low, region.high]) * self._voxel_size_mm,
        )

    def open(self, origin: np.ndarray, region: VoxelBox, lines: np.ndarray) -> OpenTile:
        """The tile at that place."""
        self._units = units_per_voxel(len(lines))
        return self._sums.open(self.place(origin, region, lines))

    def resolve(self, origin: np.ndarray, fiber_radius_mm: float) -> BrickBatch:
        """The tile's occupied bricks; its sums are clear afterwards."""
        bricks = np.flatnonzero(self._sums.used).astype(np.int32)
        names = [
            name for name in CHANNELS if name not in OPTIONAL or (name in MOMENTS and self._second_moment)
        ]
        channels = {name: empty_values(len(bricks), name) for name in names}
        # phi = pi a^2 lambda, with lambda h^3 the length in the voxel
        per_unit = math.pi * fiber_radius_mm**2 / (self._voxel_size_mm**2 * self._units)
        self._sums.resolve(bricks, per_unit, channels)
        place = np.stack(np.unravel_index(bricks, self._shape), axis=1)
        return BrickBatch((origin + place * BRICK_SIZE).astype(np.int32), **channels)
