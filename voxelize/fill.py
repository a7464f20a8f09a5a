"""Filling tiles, several at a time: strands are made, clipped and added up into bricks."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar, cast

import numpy as np

from .accumulator import BrickBatch, TileAccumulator, load_kernels
from .grid import BRICK_SIZE
from .plan import TileJob, TilePlan
from .sources import ColoredSegments, Source
from .tile_sums import TilePlace

if TYPE_CHECKING:
    from .color_sums import ColorAccumulator

Progress = Callable[[float, str], None]
Kept = TypeVar("Kept")


def fill_tiles(
    source: Source,
    plan: TilePlan,
    keep: Callable[[int, BrickBatch, int], Kept],
    *,
    workers: int,
    progress: Progress | None,
    chosen: Sequence[int] | None = None,
) -> list[Kept]:
    """What `keep` makes of each chosen job's (number, bricks, fiber length generated), in their order.

    `keep` is called in the worker, so that bricks it does not hold on to are gone before the next tile.
    """
    load_kernels()
    if plan.albedo:
        from .color_sums import ColorAccumulator, load_color_kernels

        load_color_kernels()
    numbers = range(len(plan.jobs)) if chosen is None else chosen
    own = threading.local()
    failed = threading.Event()

    def fill(number: int) -> Kept | None:
        if failed.is_set():
            return None
        try:
            if not hasattr(own, "accumulator"):
                own.accumulator = TileAccumulator(
                    plan.tile_voxels, plan.voxel_size_mm, second_moment=plan.second_moment
                )
            job = plan.jobs[number]
            tile = own.accumulator.open(job.work.origin, plan.region, plan.lines[job.medium])
            length = source.accumulate(tile, job.work)
            batch = own.accumulator.resolve(job.work.origin, source.fiber_radius_mm[job.medium])
            if plan.albedo:
                if not hasattr(own, "colors"):
                    own.colors = ColorAccumulator(plan.tile_voxels)
                place = own.accumulator.place(job.work.origin, plan.region, plan.lines[job.medium])
                batch = _colored(own.colors, place, batch, source.colored(job.work), plan)
            return keep(number, batch, length)
        except BaseException:
            # the accumulator may hold half a tile now: no other may be made with it
            failed.set()
            raise

    with ThreadPoolExecutor(max_workers=workers) as pool:
        futures = [pool.submit(fill, number) for number in numbers]
        try:
            _follow(futures, [plan.jobs[number] for number in numbers], progress, len(plan.jobs))
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
    return [cast(Kept, future.result()) for future in futures]


def _colored(
    colors: ColorAccumulator,
    place: TilePlace,
    batch: BrickBatch,
    segments: Iterable[ColoredSegments],
    plan: TilePlan,
) -> BrickBatch:
    """The bricks with the mean color of the fibers in each voxel."""
    colors.open(place)
    for piece in segments:
        colors.add(*piece)
    side = plan.tile_voxels // BRICK_SIZE
    at = (batch.origins - place.origin) // BRICK_SIZE
    bricks = np.ravel_multi_index(tuple(at.T), (side,) * 3)
    return replace(batch, albedo=colors.resolve(bricks, batch.density))


def _follow(futures: list[Future], jobs: list[TileJob], progress: Progress | None, all_jobs: int) -> None:
    """Wait for the jobs and report what part of the work is done; the first failure ends the wait."""
    place = {future: i for i, future in enumerate(futures)}
    total = sum(job.cost for job in jobs)
    done, kept = 0, all_jobs - len(jobs)
    for count, future in enumerate(as_completed(futures), start=1):
        future.result()
        done += jobs[place[future]].cost
        if progress is not None:
            progress(done / total, f"tile {kept + count} of {all_jobs}")
