"""The coarser levels of a volume whose values lie on the disk, each written to files of its own.

Level k has voxels 2^k times as large, made from the finest voxels rather than from the level before, so that
its error is measured against them and no error is handed on. Memory holds a few cubes of bricks at a time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from .fingerprint import fingerprint
from .grid_files import SECOND_LOBE
from .level_of_detail import (
    BLOCK_BRICKS,
    CoarseBlock,
    blocks_of,
    coarsen_in_order,
    coarsen_values,
    extinction_error,
)
from .parts import PartFolder, TilePart
from .stored import StoredGrid, StoredVolume, join_parts


@dataclass(frozen=True)
class LevelReport:
    """What a coarser level is, and how far its extinction is from that of the finest voxels."""

    level: int
    voxel_size_mm: float
    brick_count: int
    voxel_count: int
    """Voxels with fiber, summed over media and lobes."""
    fiber_length_mm: float
    extinction_error_mean: float
    """Of coarse / fine - 1, over voxels and directions, weighted by extinction."""
    extinction_error_rms: float
    content_sha256: str


@dataclass(frozen=True)
class Level:
    """A coarser level in its own folder of parts, ready to be written."""

    volume: StoredVolume
    folder: PartFolder
    parts: list[TilePart]
    report: LevelReport


def make_levels(volume: StoredVolume, folders: Sequence[Path], *, lobes: int, workers: int) -> list[Level]:
    """Levels 1, 2, ... of the volume, one for each folder; what lies in the folders already is removed."""
    kept = [PartFolder(path, fingerprint([("finest", volume.content_sha256)])) for path in folders]
    for folder in kept:
        folder.remove()
    side = max(BLOCK_BRICKS, 2 ** len(folders))
    jobs = [
        (medium, grid, rows)
        for medium, grid in enumerate(volume.grids.values())
        for rows in blocks_of(grid.origins, side)
    ]

    def work(medium: int, grid: StoredGrid, rows: np.ndarray) -> tuple[int, list[CoarseBlock]]:
        values = grid.read(rows)
        origins = grid.origins[rows]
        factors = [2 ** (index + 1) for index in range(len(folders))]
        return medium, [coarsen_values(origins, values, side=side, factor=f, lobes=lobes) for f in factors]

    parts: list[list[TilePart]] = [[] for _ in folders]
    sums = np.zeros((len(folders), 3))
    scale = 1 / np.array([grid.fiber_radius_mm for grid in volume.grids.values()])
    for medium, blocks in coarsen_in_order(jobs, work, workers):
        for index, block in enumerate(blocks):
            sums[index] += block.error_sums * scale[medium]
            for lobe, batch in enumerate(block.lobes):
                if not len(batch.origins):
                    continue
                number = len(parts[index])
                parts[index].append(kept[index].write(number, lobes * medium + lobe, batch, 0))
    return [
        _level(volume, index + 1, kept[index], parts[index], sums[index], lobes)
        for index in range(len(folders))
    ]


def _level(
    fine: StoredVolume, level: int, folder: PartFolder, parts: list[TilePart], sums: np.ndarray, lobes: int
) -> Level:
    names = [
        (name + ending, grid) for name, grid in fine.grids.items() for ending in ("", SECOND_LOBE)[:lobes]
    ]
    size = fine.voxel_size_mm * 2**level
    grids = {
        name: join_parts(
            folder,
            [part for part in parts if part.medium == medium],
            voxel_size_mm=size,
            fiber_radius_mm=grid.fiber_radius_mm,
            channels=tuple(grid.channels),
        )
        for medium, (name, grid) in enumerate(names)
    }
    error = extinction_error(sums)
    volume = StoredVolume(grids)
    radius = np.array([names[part.medium][1].fiber_radius_mm for part in parts])
    lengths = np.array([part.density_sum for part in parts]) * size**3 / (np.pi * radius**2)
    report = LevelReport(
        level=level,
        voxel_size_mm=size,
        brick_count=volume.brick_count,
        voxel_count=sum(part.voxel_count for part in parts),
        fiber_length_mm=float(lengths.sum()),
        extinction_error_mean=error.mean,
        extinction_error_rms=error.rms,
        content_sha256=volume.content_sha256,
    )
    about: dict[str, str | int | float] = {
        "level": level,
        "level_lobes": lobes,
        "finest_content_sha256": fine.content_sha256,
        "extinction_error_mean": error.mean,
        "extinction_error_rms": error.rms,
    }
    return Level(replace(volume, about=about), folder, parts, report)
