"""The scene of `mitsuba_volume`, rendered by weft."""

from __future__ import annotations

import time

import numpy as np

from tests.peers.mitsuba_volume import PeerImage, VolumeScene
from weft.renderer import render
from weft.renderer.config import ConstantLight, DirectionalLight, PerspectiveCamera, RenderConfig
from weft.renderer.simple_phases import HenyeyGreensteinPhase, IsotropicPhase, SggxPhase, SimplePhase
from weft.voxelize.grid import BRICK_SIZE, BRICK_VOXELS, FiberGrid, FiberVolume

FIBER_RADIUS_MM = 2 / np.pi
"""Extinction across fibers of volume fraction 1 is then 1/mm."""


def render_with_weft(scene: VolumeScene, *, samples: int, seed: int) -> PeerImage:
    """Render the scene, with the variance of each pixel mean as the film estimates it."""
    config = render_config(scene, samples=samples, seed=seed)
    started = time.process_time()
    result = render.run(config, dense_volume(scene), {"fiber": phase_of(scene)})
    cpu_seconds = time.process_time() - started
    mean = result.radiance.astype(np.float64).mean(-1)
    return PeerImage(
        mean=mean,
        variance=result.layers["variance.R"].astype(np.float64),
        paths=result.statistics.paths,
        cpu_seconds=cpu_seconds,
    )


def render_config(scene: VolumeScene, *, samples: int, seed: int) -> RenderConfig:
    """Camera, light and transport of the scene."""
    return RenderConfig(
        resolution=(scene.resolution, scene.resolution),
        samples_per_pixel=samples,
        seed=seed,
        max_bounces=1 if scene.toward_sun else 1000,
        camera=PerspectiveCamera(
            position_mm=scene.camera_position, target_mm=scene.camera_target, fov_deg=scene.fov_deg
        ),
        lights=(DirectionalLight(direction=scene.toward_sun) if scene.toward_sun else ConstantLight(),),
        background="environment",
        **_extinction(scene),
    )


def phase_of(scene: VolumeScene) -> SimplePhase:
    """Its phase function."""
    albedo = (scene.albedo,) * 3
    if scene.g is not None:
        return HenyeyGreensteinPhase(scene.g, albedo)
    if scene.flake_roughness is not None:
        return SggxPhase(scene.flake_roughness, albedo)
    return IsotropicPhase(albedo)


def _extinction(scene: VolumeScene) -> dict:
    if scene.flake_roughness is None:
        return {"extinction": "isotropic", "isotropic_extinction_per_mm": 1.0}
    return {"extinction": "projected"}


def _directions(scene: VolumeScene, counts: np.ndarray) -> np.ndarray:
    """Axes of all bricks, along x where the scene has none, float32, shape [bricks, 512, 3]."""
    if scene.axes is None:
        return np.broadcast_to(np.float32([1, 0, 0]), (int(counts.prod()), BRICK_VOXELS, 3))
    a, b, c = counts
    split = scene.axes.reshape(a, BRICK_SIZE, b, BRICK_SIZE, c, BRICK_SIZE, 3).transpose(0, 2, 4, 1, 3, 5, 6)
    return np.ascontiguousarray(split.reshape(-1, BRICK_VOXELS, 3), np.float32)


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
    direction = _directions(scene, counts)[occupied] * (density > 0)[..., None]
    grid = FiberGrid(
        voxel_size_mm=scene.voxel_size_mm,
        fiber_radius_mm=FIBER_RADIUS_MM,
        origins=(origins[occupied] * BRICK_SIZE).astype(np.int32),
        density=density,
        direction=np.ascontiguousarray(direction),
    )
    return FiberVolume({"fiber": grid})
