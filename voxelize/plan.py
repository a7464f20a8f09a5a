"""What a voxelization will do, known before it begins: its tiles in the order of space."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from weft.files.errors import InputError

from .config import VoxelizeConfig
from .coverage import line_offsets
from .memory import estimate_brick_count
from .sources import Source
from .tiles import TileWork, VoxelBox, clip_boxes, snap_region, tile_work, voxel_boxes

FARTHEST_VOXEL = 2**21
"""Beyond, float32 positions resolve less than a quarter of a voxel."""


@dataclass(frozen=True)
class TileJob:
    """One medium's share of one tile."""

    medium: int
    work: TileWork
    cost: int


@dataclass(frozen=True)
class TilePlan:
    """The work, tile by tile and medium by medium, in the order of space."""

    voxel_size_mm: float
    region: VoxelBox
    tile_voxels: int
    jobs: list[TileJob]
    lines: list[np.ndarray]
    """Of each medium, as `fiber_lines`."""
    second_moment: bool
    albedo: bool = False


def checked_region(config: VoxelizeConfig, source: Source) -> VoxelBox:
    """The region in voxels. Refuses what is not finite, empty, or lies too far out for its voxels."""
    bounds, size = source.bounds_mm, config.size_mm
    region = snap_region(config.region_mm, size)
    if not np.isfinite(bounds).all():
        raise InputError("voxelize: fiber positions are not finite numbers.", hint="Check the yarns.")
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
    return region


def _corners(bounds: np.ndarray) -> list[list[float]]:
    return [
        [round(float(x), 3) for x in corner]
        for corner in (bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0))
    ]


def fiber_lines(config: VoxelizeConfig, source: Source) -> list[np.ndarray]:
    """Of each medium, where the lines that stand for a fiber pierce its cross-section [mm], shape [n, 2]."""
    if config.fiber_shape == "line":
        return [np.zeros((1, 2), dtype=np.float32) for _ in source.media]
    return [line_offsets(config.size_mm, radius) for radius in source.fiber_radius_mm]


def _covered_bounds(config: VoxelizeConfig, source: Source) -> np.ndarray:
    """Boxes [mm] around the items, shape [item_count, 2, 3], with all that the fibers cover."""
    reach = [np.linalg.norm(offsets, axis=1).max() for offsets in fiber_lines(config, source)]
    grown = np.array(reach, dtype=np.float32)[source.medium][:, None] * np.float32(1.001)
    bounds = source.bounds_mm
    return np.stack([bounds[:, 0] - grown, bounds[:, 1] + grown], axis=1)


def brick_bound(config: VoxelizeConfig, source: Source, region: VoxelBox) -> float:
    """No more bricks than this can be occupied, all media together."""
    bounds, medium = _covered_bounds(config, source), source.medium
    return sum(
        estimate_brick_count(bounds[medium == index], voxel_size_mm=config.size_mm, region=region)
        for index in range(len(source.media))
    )


def plan_tiles(config: VoxelizeConfig, source: Source, region: VoxelBox, tile_voxels: int) -> TilePlan:
    """Every tile that a stretch of a medium may touch."""
    cost, bounds, jobs = source.cost, _covered_bounds(config, source), []
    for medium in range(len(source.media)):
        members = np.flatnonzero(source.medium == medium)
        for work in tile_work(bounds[members], voxel_size_mm=config.size_mm, region=region, tile=tile_voxels):
            items = members[work.items]
            jobs.append(TileJob(medium, replace(work, items=items), int(cost[items].sum())))
    lines = fiber_lines(config, source)
    return TilePlan(
        config.size_mm, region, tile_voxels, jobs, lines, config.second_moment, bool(config.albedo)
    )
