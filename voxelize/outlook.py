"""What a voxelization will take, before anything of it is made: a few tiles are tried and thrown away."""

from __future__ import annotations

import os
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from . import vdb
from .config import VoxelizeConfig
from .memory import INDEX_BYTES, fit_tiles, resident_bytes, tile_bytes
from .parts import PartFolder, TilePart
from .plan import TilePlan, brick_bound, checked_region, plan_tiles
from .sources import FiberSource, Source
from .stream import finish_tiles, join_tiles

if TYPE_CHECKING:
    from weft.fiber_model.fibers import FiberSet

TRIED_SECONDS = 3.0
TRIED_AT_LEAST = 4


@dataclass(frozen=True)
class Outlook:
    """Expected sizes and time. Estimates from a sample of tiles, but for what is `at_most`."""

    voxel_size_mm: float
    tile_count: int
    tried_count: int
    """Tiles that were tried, chosen at random."""
    brick_count: float
    brick_count_at_most: float
    voxel_count: float
    """Voxels with fiber."""
    vdb_bytes: float
    part_bytes: float
    """Finished tiles beside the file while it is made."""
    memory_bytes_at_most: float
    seconds: float
    tile_voxels: int
    workers: int

    def lines(self) -> list[str]:
        """For people."""
        return [
            f"voxels of {self.voxel_size_mm:g} mm in {self.tile_count:,} tiles of {self.tile_voxels} cubed, "
            f"{self.tried_count} of them tried",
            f"bricks: about {self.brick_count:,.0f}, at most {self.brick_count_at_most:,.0f}; "
            f"voxels with fiber: about {self.voxel_count / 1e6:,.3g} million",
            f"disk: about {_mebibytes(self.vdb_bytes)} for the .vdb file, "
            f"and {_mebibytes(self.part_bytes)} beside it while it is made",
            f"memory: at most {_mebibytes(self.memory_bytes_at_most)} with {self.workers} workers",
            f"time: about {self.seconds:,.3g} s",
        ]


def foresee(config: VoxelizeConfig, fibers: FiberSet, *, seconds: float = TRIED_SECONDS) -> Outlook:
    """Try tiles for about so many seconds. Raises `InputError` as `voxelize_to_files` would."""
    return foresee_source(config, FiberSource(fibers), seconds=seconds)


def foresee_source(config: VoxelizeConfig, source: Source, *, seconds: float = TRIED_SECONDS) -> Outlook:
    """`foresee` for any source."""
    config = config.sized(source.fiber_radius_mm).colored(source.has_colors)
    region = checked_region(config, source)
    bound = brick_bound(config, source, region)
    tile_voxels, workers = fit_tiles(
        bound,
        voxel_size_mm=config.size_mm,
        tile_voxels=config.tile_voxels,
        workers=len(os.sched_getaffinity(0)),
        memory_mb=config.memory_mb,
    )
    plan = plan_tiles(config, source, region, tile_voxels)
    with tempfile.TemporaryDirectory() as name:
        folder = PartFolder(Path(name) / "parts", "plan")
        parts, filling = _try_tiles(source, plan, folder, workers, seconds)
        part_bytes = sum(folder.path(part.number).stat().st_size for part in parts)
        began = time.perf_counter()
        vdb.write_volume(Path(name) / "tried.vdb", join_tiles(source, plan, folder, parts))
        writing = time.perf_counter() - began
        vdb_bytes = (Path(name) / "tried.vdb").stat().st_size
    tried_cost = sum(plan.jobs[part.number].cost for part in parts)
    share = sum(job.cost for job in plan.jobs) / max(tried_cost, 1)
    return Outlook(
        voxel_size_mm=config.size_mm,
        tile_count=len(plan.jobs),
        tried_count=len(parts),
        brick_count=share * sum(part.brick_count for part in parts),
        brick_count_at_most=bound,
        voxel_count=share * sum(part.voxel_count for part in parts),
        vdb_bytes=share * vdb_bytes,
        part_bytes=share * part_bytes,
        memory_bytes_at_most=resident_bytes() + workers * tile_bytes(tile_voxels) + bound * INDEX_BYTES,
        seconds=share * (filling + writing),
        tile_voxels=tile_voxels,
        workers=workers,
    )


def _try_tiles(
    source: Source, plan: TilePlan, folder: PartFolder, workers: int, seconds: float
) -> tuple[list[TilePart], float]:
    """Some tiles at random, a few at a time until the time is over; and the time they took."""
    order = np.random.default_rng(0).permutation(len(plan.jobs)).tolist()
    parts: list[TilePart] = []
    began = time.perf_counter()
    while len(parts) < len(order):
        batch = order[len(parts) : len(parts) + max(TRIED_AT_LEAST, 2 * workers)]
        parts += finish_tiles(source, plan, folder, workers, None, batch)
        if time.perf_counter() - began > seconds:
            break
    return parts, time.perf_counter() - began


def _mebibytes(count: float) -> str:
    return f"{count / 2**20:,.0f} MiB"
