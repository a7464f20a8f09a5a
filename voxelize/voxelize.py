"""Fibers to a sparse volume in memory: tile after tile, the same bits however they are split.

A tile takes the stretches whose boxes reach it, makes their strands inside the kernel, clips every segment
against the voxel faces and hands out its occupied bricks. Nothing else of the fibers is ever kept. Where the
bricks would not fit in memory, stream.py writes them out instead.
"""

from __future__ import annotations

import os
import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from weft.files.errors import InputError

from .accumulator import BrickBatch, accumulator_bytes
from .config import VoxelizeConfig
from .fill import Progress, fill_tiles
from .grid import CHANNELS, MOMENTS, FiberGrid, FiberVolume, empty_values
from .memory import refuse_what_does_not_fit
from .plan import TileJob, brick_bound, checked_region, plan_tiles
from .report import VoxelizeReport
from .sources import FiberSource, SegmentSource, Source, units_to_mm

if TYPE_CHECKING:
    from weft.fiber_model.fibers import FiberSet


def run(
    config: VoxelizeConfig,
    fibers: FiberSet,
    *,
    progress: Progress | None = None,
    worker_count: int | None = None,
) -> FiberVolume:
    """Voxelize all fibers; one medium per yarn type. The volume carries a `VoxelizeReport`.

    `worker_count` defaults to the cores at hand and changes no bit of the result.
    """
    return voxelize_source(config, FiberSource(fibers), progress=progress, worker_count=worker_count)


def voxelize_segments(
    config: VoxelizeConfig,
    segments: np.ndarray,
    *,
    fiber_radius_mm: float,
    medium: str = "fiber",
    progress: Progress | None = None,
    worker_count: int | None = None,
) -> FiberVolume:
    """Voxelize explicit segments [mm], shape [segment_count, 2, 3], taken as float32."""
    if segments.ndim != 3 or segments.shape[1:] != (2, 3):
        raise ValueError(f"segments have shape {segments.shape}; expected [segment_count, 2, 3]")
    if not len(segments):
        raise InputError("voxelize: there are no segments to voxelize.")
    source = SegmentSource(segments, fiber_radius_mm=fiber_radius_mm, medium=medium)
    return voxelize_source(config, source, progress=progress, worker_count=worker_count)


def voxelize_source(
    config: VoxelizeConfig, source: Source, *, progress: Progress | None, worker_count: int | None
) -> FiberVolume:
    """Plan the tiles, check that the result fits, fill them, and join their bricks."""
    began = time.perf_counter()
    config = config.sized(source.fiber_radius_mm).colored(source.has_colors)
    workers = worker_count or len(os.sched_getaffinity(0))
    region = checked_region(config, source)
    refuse_what_does_not_fit(
        brick_bound(config, source, region),
        fixed_bytes=workers * accumulator_bytes(config.tile_voxels),
        voxel_size_mm=config.size_mm,
        memory_mb=config.memory_mb,
    )
    plan = plan_tiles(config, source, region, config.tile_voxels)
    results = fill_tiles(
        source, plan, lambda _, batch, length: (batch, length), workers=workers, progress=progress
    )
    batches, generated = [batch for batch, _ in results], sum(length for _, length in results)
    del results
    grids = {
        name: _join(batches, [i for i, job in enumerate(plan.jobs) if job.medium == medium], config, radius)
        for medium, (name, radius) in enumerate(zip(source.media, source.fiber_radius_mm, strict=True))
    }
    volume = FiberVolume(grids)
    report = _report(volume, plan.jobs, units_to_mm(generated), time.perf_counter() - began)
    return replace(volume, report=report)


def _join(
    batches: list[BrickBatch], chosen: list[int], config: VoxelizeConfig, fiber_radius_mm: float
) -> FiberGrid:
    """One grid with its bricks sorted; every batch is dropped as soon as it is copied."""
    origins = np.concatenate([np.empty((0, 3), np.int32)] + [batches[i].origins for i in chosen])
    order = np.lexsort((origins[:, 2], origins[:, 1], origins[:, 0]))
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    wanted = {**dict.fromkeys(MOMENTS, config.second_moment), "albedo": config.albedo}
    names = [name for name in CHANNELS if wanted.get(name, True)]
    arrays = {name: empty_values(len(origins), name) for name in names}
    begin = 0
    empty = BrickBatch(origins[:0], empty_values(0, "density"), empty_values(0, "direction"))
    for i in chosen:
        batch, batches[i] = batches[i], empty
        rows = place[begin : begin + len(batch.origins)]
        for name, values in batch.channels.items():
            arrays[name][rows] = values
        begin += len(batch.origins)
    return FiberGrid(
        voxel_size_mm=config.size_mm,
        fiber_radius_mm=fiber_radius_mm,
        origins=np.ascontiguousarray(origins[order]),
        **arrays,
    )


def _report(volume: FiberVolume, jobs: list[TileJob], generated_mm: float, seconds: float) -> VoxelizeReport:
    densities = [grid.density for grid in volume.grids.values() if grid.brick_count]
    return VoxelizeReport(
        generated_length_mm=generated_mm,
        grid_length_mm=volume.fiber_length_mm,
        item_count=sum(int(job.work.first_visit.sum()) for job in jobs),
        visit_count=sum(len(job.work.items) for job in jobs),
        tile_count=len(jobs),
        brick_count=volume.brick_count,
        voxel_count=volume.voxel_count,
        max_volume_fraction=max((float(density.max()) for density in densities), default=0.0),
        overfull_voxel_count=sum(int(np.count_nonzero(density > 1)) for density in densities),
        seconds=seconds,
    )
