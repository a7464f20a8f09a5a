"""Free flights and transmittance against theory. Each z stays below 3.9, error probability 1e-4 per test."""

from __future__ import annotations

import math

import numpy as np
import pytest

from weft.renderer.config import ConstantLight, OrthographicCamera, RenderConfig
from weft.renderer.render import run
from weft.renderer.scene import IsotropicPhase

from .statistics import Z_LIMIT, picture_mean, z_score
from .volumes import VOXEL_MM, exact_optical_depth, projected_extinction, random_grid, uniform_grid, volume

pytestmark = pytest.mark.gl

BLACK = {"a": IsotropicPhase((0.0, 0.0, 0.0))}


def looking_through(
    grid, direction, *, frame=1e-3, tracking="exact", resolution=64, spp=16, seed=1, **settings
):
    """A black volume before a white wall: the picture's mean is the transmittance along -direction."""
    camera = OrthographicCamera(view_direction=direction, frame_width_mm=frame)
    config = RenderConfig(
        resolution=(resolution, resolution),
        samples_per_pixel=spp,
        seed=seed,
        camera=camera,
        lights=[ConstantLight()],
        background="environment",
        tracking=tracking,
        **settings,
    )
    return run(config, volume(grid), BLACK)


@pytest.mark.parametrize("tracking", ["exact", "delta"])
@pytest.mark.parametrize("angle_deg", [0.0, 15.0, 50.0, 90.0])
def test_transmittance_follows_the_angle_to_the_fibers(tracking, angle_deg):
    """exp(-(2 phi/(pi a)) sin(angle) L) through a block of parallel fibers."""
    angle = math.radians(angle_deg)
    grid = uniform_grid((2, 2, 2), 0.02, (math.cos(angle), 0, math.sin(angle)))
    result = looking_through(grid, (1.0, 0.0, 0.0), tracking=tracking)
    expected = math.exp(-projected_extinction(0.02, math.cos(angle)) * 16 * VOXEL_MM)
    if angle == 0:
        assert result.radiance.min() == 1  # nothing to run into along the fibers
    else:
        assert abs(z_score(result, expected)) < Z_LIMIT
    assert result.statistics.majorant_violations == 0


@pytest.mark.parametrize("tracking", ["exact", "delta"])
def test_extinction_is_right_to_a_quarter_percent(tracking):
    """Enough paths that an extinction off by 1 % would be 6 standard errors away."""
    grid = uniform_grid((2, 2, 2), 0.02, (0, 0.6, 0.8))
    result = looking_through(grid, (0.0, 0.0, 1.0), tracking=tracking, resolution=128, spp=48)
    depth = projected_extinction(0.02, 0.8) * 16 * VOXEL_MM
    expected = math.exp(-depth)
    assert picture_mean(result)[1] / expected / depth < 0.0025
    assert abs(z_score(result, expected)) < Z_LIMIT


@pytest.mark.parametrize("scale", [None, 70.0])
def test_isotropic_extinction_ignores_the_fibers(scale):
    grid = uniform_grid((2, 2, 2), 0.02, (1, 0, 0))
    result = looking_through(grid, (1.0, 0.0, 0.0), extinction="isotropic", isotropic_extinction_per_mm=scale)
    per_mm = scale or 1 / (2 * grid.fiber_radius_mm)
    assert abs(z_score(result, math.exp(-0.02 * per_mm * 16 * VOXEL_MM))) < Z_LIMIT


@pytest.mark.parametrize("tracking", ["exact", "delta"])
@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (0.3, -0.5, 1.0), (-0.9, 0.05, 0.1)])
def test_transmittance_of_a_random_volume(tracking, direction):
    """Against the exact integral through the middle of each pixel's tiny footprint, over several places."""
    grid = random_grid((3, 4, 3), seed=11, brick_fill=0.6)
    camera_frame = 0.6
    result = looking_through(grid, direction, frame=camera_frame, tracking=tracking, resolution=96, spp=12)
    expected, error = line_transmittance(grid, direction, camera_frame, count=3000)
    mean = result.radiance[..., 0].mean()
    spread = math.hypot(math.sqrt(result.layers["variance.R"].sum()) / 96**2, error)
    assert abs(mean - expected) < Z_LIMIT * spread
    assert result.statistics.majorant_violations == 0


def line_transmittance(grid, direction, frame, *, count):
    """Mean of exp(-optical depth) over random lines of the camera's square frame, and its standard error."""
    from weft.renderer.camera import place_camera

    camera = place_camera(
        OrthographicCamera(view_direction=direction, frame_width_mm=frame), volume(grid).bounds_mm, (1, 1)
    )
    place = np.random.default_rng(5).uniform(-1, 1, (count, 2))
    origins = camera.position + place[:, :1] * camera.right + place[:, 1:] * camera.up
    forward = np.where(np.abs(camera.forward) < 1e-9, 1e-9, camera.forward)
    values = np.exp(-exact_optical_depth(grid, origins, np.broadcast_to(forward, origins.shape)))
    return values.mean(), values.std() / math.sqrt(count)


@pytest.mark.parametrize("tracking", ["exact", "delta"])
def test_free_flight_distribution(tracking):
    """Kolmogorov-Smirnov of first collisions in a uniform block; critical value at error probability 1e-4."""
    grid = uniform_grid((2, 2, 4), 0.05, (0, 1, 0))
    result = looking_through(grid, (0.0, 0.0, 1.0), tracking=tracking, resolution=200, spp=1)
    camera_distance = np.ptp(volume(grid).bounds_mm, axis=0).sum() + 1.0 - 16 * VOXEL_MM
    depth = result.layers["Z"].ravel().astype(np.float64) - camera_distance
    depth = np.sort(depth[np.isfinite(depth)])
    sigma, length = projected_extinction(0.05, 0.0), 32 * VOXEL_MM
    cdf = -np.expm1(-sigma * depth) / -np.expm1(-sigma * length)
    steps = np.arange(len(depth) + 1) / len(depth)
    distance = max(np.abs(cdf - steps[1:]).max(), np.abs(cdf - steps[:-1]).max())
    assert len(depth) > 35_000
    assert distance < 2.23 / math.sqrt(len(depth))


def test_a_ray_along_a_voxel_edge_is_not_lost():
    """Axis-parallel rays exactly on the boundaries between voxels and bricks."""
    grid = uniform_grid((2, 2, 2), 0.02, (0, 1, 0))
    for view in [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)]:
        result = looking_through(grid, view, frame=1e-9, spp=4)
        expected = math.exp(-projected_extinction(0.02, 0.0) * 16 * VOXEL_MM)
        assert abs(z_score(result, expected)) < Z_LIMIT


def test_majorants_that_are_too_low_are_counted(monkeypatch):
    """The counter can fail: halve the majorants and it must speak."""
    from weft.renderer import kernel

    true_records = kernel.brick_records

    def low_records(pool, scale):
        records = true_records(pool, scale)
        records[:, 1] = pool.medium | (pool.majorant_level // 2) << 16
        return records

    monkeypatch.setattr(kernel, "brick_records", low_records)
    result = looking_through(random_grid((2, 2, 2), seed=3), (1.0, 0.0, 0.0), frame=0.5, tracking="delta")
    assert result.statistics.majorant_violations > 0
