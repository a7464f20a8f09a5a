"""The scene of `mitsuba_volume`, rendered by weft: isotropic phase function, isotropic extinction."""

from __future__ import annotations

import time

import numpy as np

from tests.peers.mitsuba_volume import PeerImage, VolumeScene
from weft.renderer import render
from weft.renderer.config import ConstantLight, PerspectiveCamera, RenderConfig
from weft.renderer.scene import IsotropicPhase
from weft.voxelize.grid import BRICK_SIZE, BRICK_VOXELS, FiberGrid, FiberVolume


def render_with_weft(scene: VolumeScene, *, samples: int, seed: int) -> PeerImage:
    """Render the scene, with the variance of each pixel mean as the film estimates it."""
    config = RenderConfig(
        resolution=(scene.resolution, scene.resolution),
        samples_per_pixel=samples,
        seed=seed,
        max_bounces=1000,
        camera=PerspectiveCamera(
            position_mm=scene.camera_position, target_mm=scene.camera_target, fov_deg=scene.fov_deg
        ),
        lights=(ConstantLight(),),
        background="environment",
        extinction="isotropic",
        isotropic_extinction_per_mm=1.0,
    )
    started = time.process_time()
    result = render.run(config, dense_volume(scene), {"fiber": IsotropicPhase((scene.albedo,) * 3)})
    cpu_seconds = time.process_time() - started
    mean = result.radiance.astype(np.float64).mean(-1)
    return PeerImage(
        mean=mean,
        variance=result.layers["variance.R"].astype(np.float64),
        paths=result.statistics.paths,
        cpu_seconds=cpu_seconds,
    )


def dense_volume(scene: VolumeScene) -> FiberVolume:
    """The block of extinction as bricks whose volume fraction is the extinction [1/mm]."""
    shape = np.array(scene.extinction.shape)
    assert (shape % BRICK_SIZE == 0).all(), "the block must consist of whole bricks"
    counts = shape // BRICK_SIZE
    bricks = scene.extinction.reshape(
        counts[0], BRICK_SIZE, counts[1], BRICK_SIZE, counts[2], BRICK_SIZE
    ).transpose(0, 2, 4, 1, 3, 5)
    density = np.ascontiguousarray(bricks.reshape(-1, BRICK_VOXELS), np.float32)
    origins = np.stack(np.meshgrid(*[np.arange(n) for n in counts], indexing="ij"), -1).reshape(-1, 3)
    occupied = density.any(axis=1)
    density = density[occupied]
    direction = np.zeros((*density.shape, 3), np.float32)
    direction[..., 0] = density > 0
    grid = FiberGrid(
        voxel_size_mm=scene.voxel_size_mm,
        fiber_radius_mm=0.01,
        origins=(origins[occupied] * BRICK_SIZE).astype(np.int32),
        density=density,
        direction=direction,
    )
    return FiberVolume({"fiber": grid})
