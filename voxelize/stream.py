"""Fibers to files whatever their size: tiles are written out as they are done, and joined on the disk.

Beside the result stands a folder `<result>.parts` with the finished tiles. A run that was killed, or ran out
of disk, finds them there and makes only the others; when the result is written the folder goes.
"""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from . import vdb
from .accumulator import BrickBatch
from .config import VoxelizeConfig
from .fill import Progress, fill_tiles
from .fingerprint import code_fingerprint, fingerprint
from .grid_files import level_path
from .levels import LevelReport, make_levels
from .memory import fit_tiles, refuse_what_does_not_fit
from .parts import PartFolder, TilePart
from .picture import draw_volume
from .plan import TilePlan, brick_bound, checked_region, plan_tiles
from .report import VoxelizeReport
from .sources import FiberSource, Source, units_to_mm
from .stored import StoredVolume, join_parts, load_parts

if TYPE_CHECKING:
    from weft.fiber_model.fibers import FiberSet

TILES_SHARE = 0.8
"""Part of the progress that goes to the tiles; the rest to writing the files."""
LEVELS_FROM = 0.9
"""Where in the progress the coarser levels begin, if there are any."""


@dataclass(frozen=True)
class VolumeOnDisk:
    """What was written, without its voxels."""

    content_sha256: str
    media: tuple[str, ...]
    brick_count: int
    bounds_mm: np.ndarray
    report: VoxelizeReport
    levels: tuple[LevelReport, ...] = ()
    """Of the coarser levels beside it."""


def voxelize_to_files(
    config: VoxelizeConfig,
    fibers: FiberSet,
    paths: Sequence[Path],
    *,
    progress: Progress | None = None,
    worker_count: int | None = None,
) -> VolumeOnDisk:
    """Voxelize all fibers into .vdb and .nvdb files, with resident memory bounded by `config.memory_mb`.

    The coarser levels that the config asks for stand beside each file, named as `level_path` says.

    The .vdb file has the same bytes however often the run was killed, and for any number of workers and any
    memory. A .nvdb file is laid out in memory as a whole. Raises `InputError`, and `DiskSpaceError` where the
    disk is full; the files then stay as they were.
    """
    return stream_source(config, FiberSource(fibers), paths, progress=progress, worker_count=worker_count)


def stream_source(
    config: VoxelizeConfig,
    source: Source,
    paths: Sequence[Path],
    *,
    progress: Progress | None = None,
    worker_count: int | None = None,
) -> VolumeOnDisk:
    """`voxelize_to_files` for any source."""
    began = time.perf_counter()
    config, plan, folder, workers = _planned(config, source, paths, worker_count)
    parts = finish_tiles(source, plan, folder, workers, _share(progress, 0.0, TILES_SHARE))
    volume = join_tiles(source, plan, folder, parts)
    writing = _share(progress, TILES_SHARE, 1.0 if not config.levels else LEVELS_FROM)
    for i, path in enumerate(paths):
        if writing is not None:
            writing(i / len(paths), f"writing {path.name}")
        _write(path, folder, volume, parts)
    levels = _write_levels(config, volume, paths, workers, _share(progress, LEVELS_FROM, 1.0))
    if config.picture:
        draw_volume(paths[0].with_suffix(".png"), volume)
    folder.remove()
    if progress is not None:
        progress(1.0, "written")
    report = _report(source, plan, parts, time.perf_counter() - began)
    return VolumeOnDisk(
        volume.content_sha256, volume.media, volume.brick_count, volume.bounds_mm, report, levels
    )


def make_part(
    config: VoxelizeConfig,
    fibers: FiberSet,
    paths: Sequence[Path],
    part: tuple[int, int],
    *,
    progress: Progress | None = None,
    worker_count: int | None = None,
) -> int:
    """Finish tile k, k + n, k + 2n, … of a volume for `part` = (k, n); the number of its tiles.

    They lie in the folder where `voxelize_to_files` looks for finished tiles, so any number of processes,
    on machines that share it and have memory for tiles of `config.tile_voxels`, may make one part each.
    """
    source = FiberSource(fibers)
    _, plan, folder, workers = _planned(config, source, paths, worker_count)
    chosen = range(part[0], len(plan.jobs), part[1])
    finish_tiles(source, plan, folder, workers, progress, chosen)
    return len(chosen)


def _planned(
    config: VoxelizeConfig, source: Source, paths: Sequence[Path], worker_count: int | None
) -> tuple[VoxelizeConfig, TilePlan, PartFolder, int]:
    """Config with its voxel size, the tiles, the folder of finished ones, how many to fill at once."""
    config = config.sized(source.fiber_radius_mm).colored(source.has_colors)
    size, region = config.size_mm, checked_region(config, source)
    bricks = brick_bound(config, source, region)
    if any(path.suffix == ".nvdb" for path in paths):
        refuse_what_does_not_fit(bricks, fixed_bytes=0, voxel_size_mm=size, memory_mb=config.memory_mb)
    tile_voxels, workers = fit_tiles(
        bricks,
        voxel_size_mm=size,
        tile_voxels=config.tile_voxels,
        workers=worker_count or len(os.sched_getaffinity(0)),
        memory_mb=config.memory_mb,
        albedo=bool(config.albedo),
    )
    plan = plan_tiles(config, source, region, tile_voxels)
    folder = PartFolder(parts_folder(paths[0]), _key(config, source, tile_voxels))
    return config, plan, folder, workers


def _write_levels(
    config: VoxelizeConfig,
    volume: StoredVolume,
    paths: Sequence[Path],
    workers: int,
    progress: Progress | None,
) -> tuple[LevelReport, ...]:
    """Make the coarser levels and write each beside every path."""
    numbers = range(1, config.levels + 1)
    if progress is not None and numbers:
        progress(0.0, "coarser levels")
    folders = [parts_folder(level_path(paths[0], number)) for number in numbers]
    levels = make_levels(volume, folders, lobes=config.level_lobes, workers=workers) if numbers else []
    for level in levels:
        for path in paths:
            _write(level_path(path, level.report.level), level.folder, level.volume, level.parts)
        level.folder.remove()
    return tuple(level.report for level in levels)


def parts_folder(path: Path) -> Path:
    """Where the finished tiles of a result lie until it is written."""
    return path.with_name(path.name + ".parts")


def _key(config: VoxelizeConfig, source: Source, tile_voxels: int) -> str:
    """Of all that decides a tile; memory, formats, levels, picture and workers do not."""
    others = {"memory_mb": None, "formats": ("vdb",), "levels": 0, "level_lobes": 2, "picture": False}
    settings = config.model_copy(update={**others, "tile_voxels": tile_voxels})
    return fingerprint([("config", settings), ("source", source.fingerprint()), ("code", code_fingerprint())])


def finish_tiles(
    source: Source,
    plan: TilePlan,
    folder: PartFolder,
    workers: int,
    progress: Progress | None,
    chosen: Sequence[int] | None = None,
) -> list[TilePart]:
    """The part of every tile, or of the chosen ones: those that were there, and those made now."""
    there = folder.open()

    def keep(number: int, batch: BrickBatch, length: int) -> TilePart:
        return folder.write(number, plan.jobs[number].medium, batch, length)

    numbers = range(len(plan.jobs)) if chosen is None else chosen
    missing = [number for number in numbers if number not in there]
    made = fill_tiles(source, plan, keep, workers=workers, progress=progress, chosen=missing)
    parts = there | {part.number: part for part in made}
    return [parts[number] for number in numbers]


def join_tiles(source: Source, plan: TilePlan, folder: PartFolder, parts: list[TilePart]) -> StoredVolume:
    """The volume in finished tiles."""
    return StoredVolume(
        {
            name: join_parts(
                folder,
                [part for part in parts if part.medium == medium],
                voxel_size_mm=plan.voxel_size_mm,
                fiber_radius_mm=radius,
                channels=tuple(parts[0].channels),
            )
            for medium, (name, radius) in enumerate(zip(source.media, source.fiber_radius_mm, strict=True))
        }
    )


def _write(path: Path, folder: PartFolder, volume: StoredVolume, parts: list[TilePart]) -> None:
    if path.suffix != ".nvdb":
        vdb.write_volume(path, volume)
        return
    from .nanovdb import write_volume

    write_volume(path, load_parts(folder, volume, parts))


def _share(progress: Progress | None, start: float, end: float) -> Progress | None:
    if progress is None:
        return None
    return lambda fraction, detail: progress(start + (end - start) * fraction, detail)


def _report(source: Source, plan: TilePlan, parts: list[TilePart], seconds: float) -> VoxelizeReport:
    radius = np.array(source.fiber_radius_mm)[[part.medium for part in parts]]
    fiber_volume = np.array([part.density_sum for part in parts]) * plan.voxel_size_mm**3
    return VoxelizeReport(
        generated_length_mm=units_to_mm(sum(part.generated_units for part in parts)),
        grid_length_mm=float((fiber_volume / (np.pi * radius**2)).sum()),
        item_count=sum(int(job.work.first_visit.sum()) for job in plan.jobs),
        visit_count=sum(len(job.work.items) for job in plan.jobs),
        tile_count=len(plan.jobs),
        brick_count=sum(part.brick_count for part in parts),
        voxel_count=sum(part.voxel_count for part in parts),
        max_volume_fraction=max((part.max_density for part in parts), default=0.0),
        overfull_voxel_count=sum(part.overfull_voxel_count for part in parts),
        seconds=seconds,
    )
