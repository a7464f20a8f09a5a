"""The sparse grid of each medium, in bricks of 8 x 8 x 8 voxels, as it lies in memory and in .vdb files."""

from __future__ import annotations

import hashlib
import math
import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Protocol

import numpy as np

from .report import VoxelizeReport

BRICK_SIZE = 8
BRICK_VOXELS = BRICK_SIZE**3
MOMENTS = ("moment_diag", "moment_off")
OPTIONAL = (*MOMENTS, "albedo")
CHANNELS = {"density": 1, "direction": 3, "moment_diag": 3, "moment_off": 3, "albedo": 3}
"""What a brick may hold, by the name of the field: numbers per voxel."""
COORDINATE_LIMIT = 2**30
"""Voxel coordinates stay below this in size, so that sums of two fit 32 bits."""


@dataclass(frozen=True)
class FiberGrid:
    """Fiber volume fraction and direction in the occupied bricks of one medium.

    Voxel (i, j, k) covers [i, i+1] x [j, j+1] x [k, k+1] times the voxel size, in mm. Within a brick the
    voxel with local coordinates (x, y, z) has index (x * 8 + y) * 8 + z, as in an OpenVDB leaf.
    """

    voxel_size_mm: float
    fiber_radius_mm: float
    origins: np.ndarray
    """First voxel of each brick, multiples of 8, int32, shape [brick_count, 3], sorted by (x, y, z)."""
    density: np.ndarray
    """Fiber volume fraction [1], float32, shape [brick_count, 512]; may pass 1 where fibers overlap."""
    direction: np.ndarray
    """Unit fiber axis, float32, shape [brick_count, 512, 3]; zero where the density is zero."""
    moment_diag: np.ndarray | None = None
    """Second moment T = sum l t t^T / sum l: xx, yy, zz, float32, shape [brick_count, 512, 3]; trace 1."""
    moment_off: np.ndarray | None = None
    """Its xy, xz and yz."""
    albedo: np.ndarray | None = None
    """Mean color of the fibers, linear RGB, weighted by length, float32, shape [brick_count, 512, 3]."""

    def __post_init__(self) -> None:
        for name in ("voxel_size_mm", "fiber_radius_mm"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name} is {value}; it must be positive and finite")
        count = len(self.origins)
        _check_array("origins", self.origins, np.int32, (count, 3))
        _check_array("density", self.density, np.float32, (count, BRICK_VOXELS))
        _check_array("direction", self.direction, np.float32, (count, BRICK_VOXELS, 3))
        if (self.moment_diag is None) != (self.moment_off is None):
            raise ValueError("of the second moment one half is missing")
        for name in OPTIONAL:
            if getattr(self, name) is not None:
                _check_array(name, getattr(self, name), np.float32, (count, BRICK_VOXELS, 3))
        _check_origins(self.origins)

    @property
    def brick_count(self) -> int:
        return len(self.origins)

    @property
    def channels(self) -> dict[str, np.ndarray]:
        """The arrays that stand for each voxel, in the order of `CHANNELS`."""
        held = {name: getattr(self, name) for name in CHANNELS}
        return {name: array for name, array in held.items() if array is not None}

    @cached_property
    def voxel_count(self) -> int:
        """Voxels with fiber in them."""
        return int(np.count_nonzero(self.density))

    @cached_property
    def masks(self) -> np.ndarray:
        """Which voxels hold fiber, uint64, shape [brick_count, 8]: bit (y * 8 + z) of word x."""
        return occupied(self.density)

    @cached_property
    def fiber_length_mm(self) -> float:
        """Total fiber length: sum of density h^3 / (pi a^2)."""
        volume = float(self.density.sum(dtype=np.float64)) * self.voxel_size_mm**3
        return volume / (math.pi * self.fiber_radius_mm**2)

    @property
    def bounds_mm(self) -> np.ndarray:
        """Corners of the box around the bricks [mm], float64, shape [2, 3]; zeros where there are none."""
        if not self.brick_count:
            return np.zeros((2, 3))
        low, high = self.origins.min(axis=0), self.origins.max(axis=0) + BRICK_SIZE
        return np.stack([low, high]) * self.voxel_size_mm

    def check_values(self) -> None:
        """Raise `ValueError` unless densities are finite, and directions unit where there is fiber."""
        if not np.isfinite(self.density).all() or (self.density < 0).any():
            raise ValueError("density holds values that are negative or not finite")
        squared = np.einsum("bvc,bvc->bv", self.direction, self.direction)
        expected = (self.density > 0).astype(np.float32)
        if not (np.abs(squared - expected) < 1e-4).all():
            raise ValueError(
                "direction is not a unit vector where the density is positive and zero elsewhere"
            )


@dataclass(frozen=True)
class FiberVolume:
    """The grids of one cloth, one per medium (yarn type), on the same voxels; they may overlap."""

    grids: Mapping[str, FiberGrid]
    """Medium name -> grid, in the order of the media's indices."""
    report: VoxelizeReport | None = None
    """How it was made, where it was made just now; not part of the content."""
    about: Mapping[str, str | int | float] = field(default_factory=dict)
    """What files say of it besides, by the names in `grid_files.ABOUT`; not part of the content."""

    def __post_init__(self) -> None:
        if not self.grids:
            raise ValueError("a volume needs at least one medium")
        sizes = {grid.voxel_size_mm for grid in self.grids.values()}
        if len(sizes) > 1:
            raise ValueError(f"the media have different voxel sizes: {sorted(sizes)} mm")
        object.__setattr__(self, "grids", MappingProxyType(dict(self.grids)))

    @property
    def media(self) -> tuple[str, ...]:
        return tuple(self.grids)

    @property
    def voxel_size_mm(self) -> float:
        return next(iter(self.grids.values())).voxel_size_mm

    @property
    def brick_count(self) -> int:
        return sum(grid.brick_count for grid in self.grids.values())

    @property
    def voxel_count(self) -> int:
        """Voxels with fiber in them, summed over the media."""
        return sum(grid.voxel_count for grid in self.grids.values())

    @property
    def fiber_length_mm(self) -> float:
        return sum(grid.fiber_length_mm for grid in self.grids.values())

    @property
    def bounds_mm(self) -> np.ndarray:
        """Corners of the box around all bricks [mm], float64, shape [2, 3]; zeros where there are none."""
        boxes = [grid.bounds_mm for grid in self.grids.values() if grid.brick_count]
        if not boxes:
            return np.zeros((2, 3))
        return np.stack(
            [np.min([box[0] for box in boxes], axis=0), np.max([box[1] for box in boxes], axis=0)]
        )

    @cached_property
    def content_sha256(self) -> str:
        """SHA-256 over the media and the digests of their bricks; what the files carry."""
        return content_hash(
            ContentOf(name, grid, tuple(grid.channels), brick_digests(grid.origins, grid.channels.values()))
            for name, grid in self.grids.items()
        )


class _HasSizes(Protocol):
    """A grid of one medium, in memory or on the disk."""

    @property
    def voxel_size_mm(self) -> float: ...
    @property
    def fiber_radius_mm(self) -> float: ...


@dataclass(frozen=True)
class ContentOf:
    """What the content hash of a volume says of one medium."""

    medium: str
    grid: _HasSizes
    channels: tuple[str, ...]
    digests: np.ndarray
    """SHA-256 of each brick, in the order of the bricks, uint8, shape [brick_count, 32]."""


def content_hash(media: Iterable[ContentOf]) -> str:
    """SHA-256 of a volume, from the digests of its bricks, which can be made tile by tile."""
    digest = hashlib.sha256()
    for content in media:
        names = f"{content.medium}\0{' '.join(content.channels)}".encode()
        digest.update(struct.pack("<Q", len(names)) + names)
        grid = content.grid
        digest.update(struct.pack("<ddQ", grid.voxel_size_mm, grid.fiber_radius_mm, len(content.digests)))
        digest.update(np.ascontiguousarray(content.digests).data)
    return digest.hexdigest()


def brick_digests(origins: np.ndarray, channels: Iterable[np.ndarray]) -> np.ndarray:
    """SHA-256 of each brick's origin and little-endian values, uint8, shape [brick_count, 32]."""
    digests = np.empty((len(origins), 32), dtype=np.uint8)
    places = np.ascontiguousarray(origins, dtype="<i4")
    values = [np.ascontiguousarray(channel, dtype="<f4") for channel in channels]
    for row, place in enumerate(places):
        digest = hashlib.sha256(place.data)
        for channel in values:
            digest.update(channel[row].data)
        digests[row] = np.frombuffer(digest.digest(), dtype=np.uint8)
    return digests


def empty_values(brick_count: int, channel: str) -> np.ndarray:
    """Zeros for all voxels of so many bricks, float32, shape [brick_count, 512(, 3)]."""
    width = CHANNELS[channel]
    shape = (brick_count, BRICK_VOXELS) if width == 1 else (brick_count, BRICK_VOXELS, width)
    return np.zeros(shape, dtype=np.float32)


def occupied(density: np.ndarray) -> np.ndarray:
    """Which voxels hold fiber, uint64, shape [brick_count, 8]: bit (y * 8 + z) of word x."""
    return np.packbits(density > 0, axis=1, bitorder="little").view("<u8")


def _check_array(name: str, array: np.ndarray, kind: type, shape: tuple[int, ...]) -> None:
    if array.dtype != kind or array.shape != shape:
        raise ValueError(
            f"{name} is {array.dtype}{list(array.shape)}; expected {np.dtype(kind)}{list(shape)}"
        )


def _check_origins(origins: np.ndarray) -> None:
    if not len(origins):
        return
    if (origins % BRICK_SIZE).any():
        raise ValueError(f"origins are not multiples of {BRICK_SIZE}")
    if origins.min() <= -COORDINATE_LIMIT or origins.max() >= COORDINATE_LIMIT:
        raise ValueError(f"origins reach beyond {COORDINATE_LIMIT} voxels")
    step = np.diff(origins.astype(np.int64), axis=0)
    ascending = (step[:, 0] > 0) | (
        (step[:, 0] == 0) & ((step[:, 1] > 0) | ((step[:, 1] == 0) & (step[:, 2] > 0)))
    )
    if not ascending.all():
        raise ValueError("origins are not sorted by (x, y, z), or repeat")
