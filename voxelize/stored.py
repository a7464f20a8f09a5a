"""A volume whose values lie in the files of finished tiles; in memory are its bricks' places and masks."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from .grid import BRICK_SIZE, CHANNELS, ContentOf, FiberGrid, FiberVolume, content_hash, empty_values
from .parts import PartFolder, TilePart


@dataclass(frozen=True)
class StoredGrid:
    """One medium. Bricks are sorted by (x, y, z), as in `FiberGrid`."""

    voxel_size_mm: float
    fiber_radius_mm: float
    channels: tuple[str, ...]
    origins: np.ndarray
    masks: np.ndarray
    digests: np.ndarray
    """SHA-256 of each brick, uint8, shape [brick_count, 32]."""
    paths: tuple[Path, ...]
    files: np.ndarray
    """Which path holds each brick, int32, shape [brick_count]."""
    offsets: Mapping[str, np.ndarray]
    """Per channel, where in its file the brick's values begin, int64, shape [brick_count]."""

    @property
    def brick_count(self) -> int:
        return len(self.origins)

    def read(self, rows: np.ndarray) -> dict[str, np.ndarray]:
        """The channels of some bricks, float32, shape [len(rows), 512(, 3)]."""
        inside = np.unpackbits(self.masks[rows].view(np.uint8), axis=1, bitorder="little").astype(bool)
        counts = inside.sum(axis=1).tolist()
        found = {name: empty_values(len(rows), name) for name in self.channels}
        for index in np.unique(self.files[rows]):
            with open(self.paths[index], "rb", buffering=0) as file:
                for i in np.flatnonzero(self.files[rows] == index).tolist():
                    for name in self.channels:
                        width = CHANNELS[name]
                        packed = os.pread(
                            file.fileno(), 4 * counts[i] * width, int(self.offsets[name][rows[i]])
                        )
                        values = np.frombuffer(packed, dtype="<f4")
                        found[name][i, inside[i]] = values if width == 1 else values.reshape(-1, width)
        return found


@dataclass(frozen=True)
class StoredVolume:
    """The media of a cloth, as `FiberVolume`, on the disk."""

    grids: Mapping[str, StoredGrid]
    about: Mapping[str, str | int | float] = field(default_factory=dict)
    """As in `FiberVolume`."""

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
    def bounds_mm(self) -> np.ndarray:
        """Corners of the box around all bricks [mm], float64, shape [2, 3]; zeros where there are none."""
        places = [grid.origins for grid in self.grids.values() if grid.brick_count]
        if not places:
            return np.zeros((2, 3))
        low = np.min([origins.min(axis=0) for origins in places], axis=0)
        high = np.max([origins.max(axis=0) for origins in places], axis=0) + BRICK_SIZE
        return np.stack([low, high]) * self.voxel_size_mm

    @cached_property
    def content_sha256(self) -> str:
        """The same as that of the `FiberVolume` with these values."""
        return content_hash(
            ContentOf(name, grid, grid.channels, grid.digests) for name, grid in self.grids.items()
        )


def join_parts(
    folder: PartFolder,
    parts: Sequence[TilePart],
    *,
    voxel_size_mm: float,
    fiber_radius_mm: float,
    channels: tuple[str, ...],
) -> StoredGrid:
    """The grid in the finished tiles of one medium."""
    filled = [part for part in parts if part.brick_count]
    indices = [folder.index(part) for part in filled]
    origins = np.concatenate([np.empty((0, 3), np.int32), *(index.origins for index in indices)])
    order = np.lexsort((origins[:, 2], origins[:, 1], origins[:, 0]))
    files = np.repeat(np.arange(len(filled), dtype=np.int32), [part.brick_count for part in filled])

    def sorted_rows(arrays: list[np.ndarray], empty: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(np.concatenate([empty, *arrays])[order])

    return StoredGrid(
        voxel_size_mm=voxel_size_mm,
        fiber_radius_mm=fiber_radius_mm,
        channels=channels,
        origins=np.ascontiguousarray(origins[order]),
        masks=sorted_rows([index.masks for index in indices], np.empty((0, 8), np.uint64)),
        digests=sorted_rows([index.digests for index in indices], np.empty((0, 32), np.uint8)),
        paths=tuple(folder.path(part.number) for part in filled),
        files=np.ascontiguousarray(files[order]),
        offsets={
            name: sorted_rows([index.offsets[name] for index in indices], np.empty(0, np.int64))
            for name in channels
        },
    )


def load_parts(folder: PartFolder, volume: StoredVolume, parts: Sequence[TilePart]) -> FiberVolume:
    """All values in memory, for the writers that need them so."""
    grids = {}
    for medium, (name, stored) in enumerate(volume.grids.items()):
        filled = [part for part in parts if part.medium == medium and part.brick_count]
        arrays = {channel: empty_values(stored.brick_count, channel) for channel in stored.channels}
        for file, part in enumerate(filled):
            rows = np.flatnonzero(stored.files == file)
            # within a tile bricks are sorted, and so are they in the grid
            for channel, values in folder.values(part).items():
                arrays[channel][rows] = values
        grids[name] = FiberGrid(
            voxel_size_mm=stored.voxel_size_mm,
            fiber_radius_mm=stored.fiber_radius_mm,
            origins=stored.origins,
            **arrays,
        )
    return FiberVolume(grids, about=volume.about)
