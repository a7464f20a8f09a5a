"""Fibers to a sparse volume: tile after tile, several at a time, the same bits however they are split.

A tile takes the stretches whose boxes reach it, makes their strands inside the kernel, clips every segment
against the voxel faces and hands out its occupied bricks. Nothing else of the fibers is ever kept.
"""

from __future__ import annotations

import os
import queue
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from weft.files.errors import InputError

from .accumulator import BrickBatch, TileAccumulator, accumulator_bytes
from .config import VoxelizeConfig
from .grid import BRICK_VOXELS, FiberGrid, FiberVolume
from .memory import estimate_brick_count, refuse_what_does_not_fit
from .report import VoxelizeReport
from .sources import FiberSource, SegmentSource, Source, load_kernels, region_limits, units_to_mm
from .tiles import TileWork, VoxelBox, clip_boxes, snap_region, tile_work, voxel_boxes

if TYPE_CHECKING:
    from weft.fiber_model.fibers import FiberSet

Progress = Callable[[float, str], None]

FARTHEST_VOXEL = 2**21
"""Beyond, float32 positions resolve less than a quarter of a voxel."""


@dataclass(frozen=True)
class _Job:
    """One medium's share of one tile."""

    medium: int
    work: TileWork
    cost: int


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
    workers = worker_count or len(os.sched_getaffinity(0))
    region = snap_region(config.region_mm, config.voxel_size_mm)
    _check_source(config, source, region, workers)
    jobs = list(_plan(config, source, region))
    batches, generated = _fill(config, source, region, jobs, workers, progress)
    grids = {
        name: _join(batches, [i for i, job in enumerate(jobs) if job.medium == medium], config, radius)
        for medium, (name, radius) in enumerate(zip(source.media, source.fiber_radius_mm, strict=True))
    }
    volume = FiberVolume(grids)
    report = _report(volume, jobs, units_to_mm(generated), time.perf_counter() - began)
    return replace(volume, report=report)


def _check_source(config: VoxelizeConfig, source: Source, region: VoxelBox, workers: int) -> None:
    """Refuse what is not finite, does not fit in memory, or lies too far out for its voxels."""
    bounds, size = source.bounds_mm, config.voxel_size_mm
    if not np.isfinite(bounds).all():
        raise InputError("voxelize: fiber positions are not finite numbers.", hint="Check the yarns.")
    bricks = sum(
        estimate_brick_count(bounds[source.medium == medium], voxel_size_mm=size, region=region)
        for medium in range(len(source.media))
    )
    refuse_what_does_not_fit(
        bricks,
        fixed_bytes=workers * accumulator_bytes(config.tile_voxels),
        voxel_size_mm=size,
        memory_mb=config.memory_mb,
    )
    _, low, high = clip_boxes(*voxel_boxes(bounds, size), region)
    if not len(low):
        raise InputError(
            f"voxelize.region_mm: no fiber lies in it; the fibers fill {_corners(bounds)} mm."
            if config.region_mm is not None
            else "voxelize: there are no fibers to voxelize."
        )
    farthest = max(-int(low.min()), int(high.max()))
    if farthest > FARTHEST_VOXEL:
        raise InputError(
            f"voxelize: fibers reach {farthest} voxels from the origin; "
            f"float32 positions allow {FARTHEST_VOXEL}. "
            "Raise voxelize.voxel_size_mm or move the yarns to the origin."
        )


def _corners(bounds: np.ndarray) -> list[list[float]]:
    return [
        [round(float(x), 3) for x in corner]
        for corner in (bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0))
    ]


def _plan(config: VoxelizeConfig, source: Source, region: VoxelBox) -> Iterator[_Job]:
    """Jobs medium by medium, in the order of space."""
    cost = source.cost
    for medium in range(len(source.media)):
        members = np.flatnonzero(source.medium == medium)
        for work in tile_work(
            source.bounds_mm[members],
            voxel_size_mm=config.voxel_size_mm,
            region=region,
            tile=config.tile_voxels,
        ):
            items = members[work.items]
            yield _Job(medium, replace(work, items=items), int(cost[items].sum()))


def _fill(
    config: VoxelizeConfig,
    source: Source,
    region: VoxelBox,
    jobs: list[_Job],
    workers: int,
    progress: Progress | None,
) -> tuple[list[BrickBatch], int]:
    """The bricks of every job, and the fiber length generated. Warp launches release the interpreter lock."""
    load_kernels()
    limits = region_limits(region, config.voxel_size_mm)
    idle: queue.SimpleQueue[TileAccumulator] = queue.SimpleQueue()
    for _ in range(min(workers, len(jobs))):
        idle.put(TileAccumulator(config.tile_voxels, config.voxel_size_mm))

    def fill(job: _Job) -> tuple[BrickBatch, int]:
        accumulator = idle.get()
        length = source.accumulate(accumulator.open(job.work.origin, region), job.work, limits)
        batch = accumulator.resolve(job.work.origin, source.fiber_radius_mm[job.medium])
        idle.put(accumulator)
        return batch, length

    with ThreadPoolExecutor(max_workers=workers) as pool:
        futures = [pool.submit(fill, job) for job in jobs]
        try:
            _follow(futures, jobs, progress)
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
    results = [future.result() for future in futures]
    return [batch for batch, _ in results], sum(length for _, length in results)


def _follow(futures: list[Future], jobs: list[_Job], progress: Progress | None) -> None:
    """Wait for the jobs and report what part of the work is done; the first failure ends the wait."""
    place = {future: i for i, future in enumerate(futures)}
    total = sum(job.cost for job in jobs)
    done = 0
    for count, future in enumerate(as_completed(futures), start=1):
        future.result()
        done += jobs[place[future]].cost
        if progress is not None:
            progress(done / total, f"tile {count} of {len(jobs)}")


def _join(
    batches: list[BrickBatch], chosen: list[int], config: VoxelizeConfig, fiber_radius_mm: float
) -> FiberGrid:
    """One grid with its bricks sorted; every batch is dropped as soon as it is copied."""
    origins = np.concatenate([np.empty((0, 3), np.int32)] + [batches[i].origins for i in chosen])
    order = np.lexsort((origins[:, 2], origins[:, 1], origins[:, 0]))
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    density = np.empty((len(origins), BRICK_VOXELS), dtype=np.float32)
    direction = np.empty((len(origins), BRICK_VOXELS, 3), dtype=np.float32)
    begin = 0
    empty = BrickBatch(origins[:0], density[:0], direction[:0])
    for i in chosen:
        batch, batches[i] = batches[i], empty
        rows = place[begin : begin + len(batch.origins)]
        density[rows], direction[rows] = batch.density, batch.direction
        begin += len(batch.origins)
    return FiberGrid(
        voxel_size_mm=config.voxel_size_mm,
        fiber_radius_mm=fiber_radius_mm,
        origins=np.ascontiguousarray(origins[order]),
        density=density,
        direction=direction,
    )


def _report(volume: FiberVolume, jobs: list[_Job], generated_mm: float, seconds: float) -> VoxelizeReport:
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
