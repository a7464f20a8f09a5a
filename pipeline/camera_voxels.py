"""`[voxelize] voxels_per_pixel`: the voxel size that the job's camera asks for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from weft.files.errors import InputError

from .job import Job
from .pictures_of import jobs_of_pictures

if TYPE_CHECKING:
    from weft.fiber_model.fibers import FiberSet
    from weft.voxelize.config import VoxelizeConfig


def camera_settings(job: Job) -> dict[str, Any]:
    """What of [render] decides the voxel size."""
    if job.table("voxelize").voxels_per_pixel is None or not job.has("render"):
        return {}
    table = job.table("render")
    names = ("resolution", "camera", "cameras", "turntable")
    return {f"render.{name}": getattr(table, name) for name in names}


def sized_by_camera(job: Job, fibers: FiberSet) -> VoxelizeConfig:
    """The [voxelize] table with its voxel size, where that is left to the camera."""
    config = job.table("voxelize")
    if config.voxels_per_pixel is None:
        return config
    if not job.has("render"):
        raise InputError(
            "voxelize.voxels_per_pixel needs the table [render], which the job lacks", path=job.path
        )
    from weft.renderer.camera import nearest_pixel_mm, place_camera

    boxes = fibers.stretch_bounds().astype(np.float64)
    if config.region_mm is not None:
        low, high = np.maximum(boxes[:, 0], config.region_mm[0]), np.minimum(boxes[:, 1], config.region_mm[1])
        boxes = np.stack([low, high], axis=1)[(low < high).all(axis=1)]
        if not len(boxes):
            return config.seen_by(1.0)  # voxelizing says that the region is empty
    bounds = np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])
    widths = []
    for picture in jobs_of_pictures(job):
        table = picture.table("render")
        frame = place_camera(table.camera, bounds, table.resolution)
        widths.append(nearest_pixel_mm(frame, boxes, table.resolution))
    return config.seen_by(min(widths))
