"""A tile's sums by Warp's kernels: for GPUs, and for the CPU where weft was built without a C++ compiler."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp

from . import kernels
from .grid import BRICK_VOXELS, MOMENTS, empty_values
from .kernels import SUM_COUNT, accumulate_points, resolve_bricks
from .tile_sums import DEVICE, TilePlace


def load_kernels() -> None:
    """Compile the kernels, or fetch them from Warp's cache, before threads ask for them."""
    wp.load_module(kernels, device=DEVICE)


class WarpTileSums:
    """`TileSums` on Warp's device."""

    def __init__(self, bricks_per_side: int) -> None:
        self._bricks_per_side = bricks_per_side
        # fresh zero pages cost nothing until fibers reach their brick
        self._sums = _shared(np.zeros(bricks_per_side**3 * BRICK_VOXELS * SUM_COUNT, np.int64), wp.int64)
        self._used = _shared(np.zeros(bricks_per_side**3, np.uint8), wp.uint8)

    @property
    def used(self) -> np.ndarray:
        return self._used.numpy()

    def open(self, place: TilePlace) -> _WarpTile:
        tile = kernels.TileSums()
        tile.origin = wp.vec3i(*place.origin.tolist())
        tile.low = wp.vec3i(*place.low.tolist())
        tile.high = wp.vec3i(*place.high.tolist())
        tile.bricks_per_side = self._bricks_per_side
        tile.inverse_voxel_size = 1.0 / place.voxel_size_mm
        tile.scale = place.scale
        tile.sums = self._sums
        tile.used = self._used
        tile.offsets = _shared(np.ascontiguousarray(place.lines, dtype=np.float32), wp.vec2)
        return _WarpTile(tile, place.region_mm)

    def resolve(self, bricks: np.ndarray, per_unit: float, channels: Mapping[str, np.ndarray]) -> None:
        moments = [channels.get(name, empty_values(0, name)) for name in MOMENTS]
        vectors = [_shared(array, wp.vec3) for array in (channels["direction"], *moments)]
        wp.launch(
            resolve_bricks,
            dim=(len(bricks), BRICK_VOXELS),
            inputs=[self._sums, _shared(bricks, wp.int32), per_unit],
            outputs=[_shared(channels["density"], wp.float32), *vectors],
            device=DEVICE,
        )
        self._used.numpy()[bricks] = 0


class _WarpTile:
    """`OpenTile` on Warp's device."""

    device = DEVICE

    def __init__(self, tile: Any, region_mm: np.ndarray) -> None:
        self._tile = tile
        self._limits = [wp.vec3d(*corner) for corner in region_mm]

    def add(self, points: Any, flags: np.ndarray, *, stride: int, order: np.ndarray | None = None) -> int:
        length = np.zeros(len(flags), dtype=np.int64)
        inputs = [
            points if isinstance(points, wp.array) else _shared(points, wp.vec3),
            _shared(flags, wp.uint8),
            stride,
            _shared(np.empty(0, np.int32) if order is None else order, wp.int32),
            *self._limits,
        ]
        outputs = [_shared(length, wp.int64)]
        wp.launch(accumulate_points, len(flags), [self._tile, *inputs], outputs=outputs, device=DEVICE)
        return int(length.sum())


def _shared(array: np.ndarray, dtype: type) -> wp.array:
    """A Warp array on the memory of a numpy array."""
    return wp.array(array, dtype=dtype, device=DEVICE, copy=False)
