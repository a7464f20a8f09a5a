"""A kernel in as much memory as the device has: fewer paths at a time, voxels through a pool; the same bits.

The sums of the picture are made to fit by the kernel itself (`Kernel.film_bytes`): fewer pixels at a time.
"""

from __future__ import annotations

from dataclasses import replace

import moderngl

from weft.files.errors import DeviceMemoryError

from .gpu.buffers import MIB
from .kernel import GROUP_SIZE, PATHS, Kernel, KernelOptions, default_lane_count
from .out_of_core import build_kernel
from .pager import pool_capacity
from .scene import Scene

SMALLEST_POOL_BRICKS = 16
"""Below, nearly every step would wait for a brick."""
Attempt = tuple[Scene, KernelOptions]


def kernel_that_fits(context: moderngl.Context, scene: Scene, options: KernelOptions) -> Kernel:
    """The kernel, with a smaller pool of bricks or fewer paths where the device refuses what was asked for.

    Raises `DeviceMemoryError`, with the bytes needed and available, where nothing smaller is left.
    """
    attempt: Attempt | None = (scene, options)
    while attempt is not None:
        scene, options = attempt
        try:
            return build_kernel(context, scene, options)
        except DeviceMemoryError as error:
            refused = error
            attempt = _smaller(context, scene, options, paths_first=getattr(error, "name", "") == PATHS)
        refused.__traceback__ = None  # holds the buffers that were there
    raise refused


def what_was_made_smaller(asked: Scene, options: KernelOptions, kernel: Kernel) -> str:
    """For people: what of the scene asked for the device had no room for; empty where it had."""
    parts = []
    if kernel.scene.config.brick_pool_mb != asked.config.brick_pool_mb:
        whole = len(asked.pool.voxels) * 4 * asked.pool.brick_words / MIB
        pool = kernel.scene.config.brick_pool_mb or 0
        parts.append(f"{whole:.4g} MiB of voxels through a pool of {pool:.4g} MiB")
    if kernel.options.lane_count != options.lane_count:
        parts.append(f"{kernel.lane_count} paths at a time")
    return ", ".join(parts)


def _smaller(
    context: moderngl.Context, scene: Scene, options: KernelOptions, *, paths_first: bool
) -> Attempt | None:
    steps = [_with_fewer_bricks(scene, options), _with_fewer_paths(context, scene, options)]
    if paths_first:
        steps.reverse()
    return next((step for step in steps if step is not None), None)


def _with_fewer_bricks(scene: Scene, options: KernelOptions) -> Attempt | None:
    """Half the bricks; None where the pool would decide what is seen, or is as small as can be."""
    if scene.config.outside_batch != "park":
        return None
    bricks = (pool_capacity(scene) or len(scene.pool.voxels)) // 2
    if bricks < max(SMALLEST_POOL_BRICKS, 2 * scene.pool.layer_count):
        return None
    config = scene.config.model_copy(update={"brick_pool_mb": bricks * 4 * scene.pool.brick_words / MIB})
    return replace(scene, config=config), options


def _with_fewer_paths(context: moderngl.Context, scene: Scene, options: KernelOptions) -> Attempt | None:
    lanes = (options.lane_count or default_lane_count(context)) // 2
    return None if lanes < GROUP_SIZE else (scene, replace(options, lane_count=lanes))
