"""Ray by ray: each pixel sees one column of voxels, whose transmittance is known exactly.

Ten thousand rays for each estimator. Error probability 1e-4 for each assertion.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy import stats

from weft.renderer.config import ConstantLight, DirectionalLight, OrthographicCamera, RenderConfig
from weft.renderer.render import run
from weft.renderer.scene import SHADOW_ROULETTE
from weft.renderer.simple_phases import IsotropicPhase
from weft.renderer.surface_config import DiffuseMaterial, GroundSurface

from .statistics import Z_LIMIT, z_score
from .volumes import VOXEL_MM, projected_extinction, random_grid, uniform_grid, volume

pytestmark = pytest.mark.gl

CELLS = (3, 13, 13)
SIDE = 13 * 8
"""Columns of voxels along y and z, and pixels of the picture."""
TILE = 8
ERROR_PROBABILITY = 1e-4
ROUNDING = 2e-6
"""Of a pixel, in single precision."""


def columns(grid) -> np.ndarray:
    """Optical depth of every column of voxels along x, from the stored values; [SIDE, SIDE] by (y, z)."""
    depth = np.zeros((SIDE, SIDE))
    for origin, density in zip(grid.origins, grid.density.astype(np.float64), strict=True):
        sigma = (projected_extinction(1.0, 0.0) * density).reshape(8, 8, 8).sum(axis=0) * VOXEL_MM
        depth[origin[1] : origin[1] + 8, origin[2] : origin[2] + 8] += sigma
    return depth


def face_on(**settings) -> dict:
    """Pixels on columns of voxels, seen along -x: rows from the top (y), columns along -z."""
    middle = SIDE * VOXEL_MM / 2
    defaults = {
        "resolution": (SIDE, SIDE),
        "camera": OrthographicCamera(
            view_direction=(1.0, 0.0, 0.0), target_mm=(0.6, middle, middle), frame_width_mm=SIDE * VOXEL_MM
        ),
        "max_bounces": 4,
    }
    return defaults | settings


@pytest.fixture(scope="module")
def grid():
    """Fibers across the rays, of densities that 12 bits hold exactly."""
    found = random_grid(CELLS, seed=71, fill=0.4, peak=0.15, brick_fill=0.7)
    peak = found.density.max(axis=1, keepdims=True)
    density = (np.rint(found.density / peak * 4095) * (peak / 4095)).astype(np.float32)
    axis = np.where(density[..., None] > 0, np.float32([0, 0, 1]), np.float32(0)).astype(np.float32)
    return dataclasses.replace(found, density=density, direction=axis)


def expected_picture(grid) -> np.ndarray:
    return np.exp(-columns(grid))[::-1, ::-1]


@pytest.mark.parametrize("tracking", ["exact", "delta"])
def test_free_flights_leave_each_column_as_often_as_they_should(grid, tracking):
    """Counts of each ray are binomial: chi-square over 10,816 rays, and no ray off by more than 6 errors."""
    samples = 64
    config = RenderConfig(
        **face_on(),
        samples_per_pixel=samples,
        lights=[ConstantLight()],
        background="environment",
        tracking=tracking,
    )
    result = run(config, volume(grid), {"a": IsotropicPhase((0.0, 0.0, 0.0))})
    passed, chance = result.radiance[..., 0].astype(np.float64), expected_picture(grid)
    certain = chance > 1 - 1e-9
    assert (passed[certain] == 1).all()
    z = (passed - chance)[~certain] / np.sqrt(chance * (1 - chance) / samples)[~certain]
    assert len(z) > 9000
    assert abs(z.sum()) / math.sqrt(len(z)) < Z_LIMIT
    fair = (chance[~certain] * samples > 5) & ((1 - chance[~certain]) * samples > 5)
    assert stats.chi2.sf((z[fair] ** 2).sum(), fair.sum()) > ERROR_PROBABILITY
    assert stats.chi2.cdf((z[fair] ** 2).sum(), fair.sum()) > ERROR_PROBABILITY


@pytest.mark.proof
@pytest.mark.parametrize("shadows", ["exact", "ratio", "residual_ratio"])
def test_shadow_rays_know_each_column(grid, shadows):
    """A white ground behind the volume, seen from between the two, under light that came through."""
    ground = GroundSurface(
        normal=(1.0, 0.0, 0.0), gap_mm=1.0, size_mm=40.0, material=DiffuseMaterial(color=(1.0, 1.0, 1.0))
    )
    middle = SIDE * VOXEL_MM / 2
    settings = face_on(max_bounces=1, shadow_tracking=shadows, surfaces=[ground])
    camera = OrthographicCamera(
        position_mm=(-0.5, middle, middle), target_mm=(-0.6, middle, middle), frame_width_mm=SIDE * VOXEL_MM
    )
    config = RenderConfig(
        **(settings | {"camera": camera}),
        samples_per_pixel=16,
        lights=[DirectionalLight(direction=(1.0, 0.0, 0.0), irradiance=(math.pi,) * 3)],
    )
    result = run(config, volume(grid), {"a": IsotropicPhase()})
    passed = expected_picture(grid)
    difference = result.radiance[..., 0].astype(np.float64) - passed
    # roulette below c alone has the variance c T - T^2 of a sample, more where T itself is estimated (Jensen)
    least = np.where(passed < SHADOW_ROULETTE, (SHADOW_ROULETTE - passed) * passed, 0) / 16
    variance = np.maximum(result.layers["variance.R"].astype(np.float64), least)
    tiles, spread = tile_sums(difference), np.sqrt(tile_sums(variance) + (TILE**2 * ROUNDING) ** 2)
    limit = stats.norm.isf(ERROR_PROBABILITY / 2 / tiles.size)
    assert abs(difference.sum()) < Z_LIMIT * math.sqrt(variance.sum())
    often = tile_sums(passed) * 16 / SHADOW_ROULETTE > 50  # so many rays survive that their number is normal
    assert often.sum() > 100
    assert np.abs(tiles / spread)[often].max() < limit


def tile_sums(picture: np.ndarray) -> np.ndarray:
    count = SIDE // TILE
    return picture.reshape(count, TILE, count, TILE).sum(axis=(1, 3))


@pytest.mark.parametrize("tracking", ["exact", "delta"])
def test_first_collisions_in_layers_follow_their_exact_distribution(tracking):
    """Kolmogorov-Smirnov of depths in 24 layers of random density, some of them empty."""
    grid = random_grid((3, 2, 2), seed=5)
    rng = np.random.default_rng(8)
    layer = np.where(rng.random(24) < 0.4, 0, rng.random(24) * 0.15)
    x = grid.origins[:, :1] + np.repeat(np.arange(8), 64)
    density = layer[x].astype(np.float32)
    axis = np.where(density[..., None] > 0, np.float32([0, 1, 0]), np.float32(0)).astype(np.float32)
    grid = dataclasses.replace(grid, density=density, direction=axis)
    camera = OrthographicCamera(
        view_direction=(-1.0, 0.0, 0.0), position_mm=(-1.0, 0.4, 0.4), frame_width_mm=0.5
    )
    config = RenderConfig(
        resolution=(200, 200),
        samples_per_pixel=1,
        seed=3,
        camera=camera,
        lights=[ConstantLight()],
        tracking=tracking,
    )
    result = run(config, volume(grid), {"a": IsotropicPhase((0.0, 0.0, 0.0))})
    depth = result.layers["Z"].ravel().astype(np.float64) - 1.0
    depth = np.sort(depth[np.isfinite(depth)])
    edges = np.arange(25) * VOXEL_MM
    passed = np.concatenate([[0.0], np.cumsum(projected_extinction(1.0, 0.0) * layer * VOXEL_MM)])
    cdf = np.expm1(-np.interp(depth, edges, passed)) / np.expm1(-passed[-1])
    steps = np.arange(len(depth) + 1) / len(depth)
    distance = max(np.abs(cdf - steps[1:]).max(), np.abs(cdf - steps[:-1]).max())
    assert len(depth) > 20_000
    assert distance < 2.23 / math.sqrt(len(depth))


def test_residual_rays_pass_where_their_bricks_are_empty():
    """Six bricks, half full: controls dim what factors above 1 restore, on average to all of it."""
    grid = uniform_grid((6, 1, 1), 0.1, (0.0, 0.0, 1.0))
    full = np.tile(np.arange(8)[None, :, None] < 4, (8, 1, 8)).ravel()
    grid = dataclasses.replace(
        grid,
        density=np.where(full, grid.density, np.float32(0)),
        direction=np.where(full[:, None], grid.direction, np.float32(0)),
    )
    ground = GroundSurface(
        normal=(1.0, 0.0, 0.0), gap_mm=1.0, size_mm=40.0, material=DiffuseMaterial(color=(1.0, 1.0, 1.0))
    )
    place = (6 * VOXEL_MM, 4 * VOXEL_MM)
    config = RenderConfig(
        resolution=(40, 40),
        samples_per_pixel=512,
        max_bounces=1,
        camera=OrthographicCamera(position_mm=(-0.5, *place), target_mm=(-0.6, *place), frame_width_mm=1e-3),
        lights=[DirectionalLight(direction=(1.0, 0.0, 0.0), irradiance=(math.pi,) * 3)],
        surfaces=[ground],
        shadow_tracking="residual_ratio",
    )
    result = run(config, volume(grid), {"a": IsotropicPhase()})
    assert result.layers["variance.R"].mean() > 1e-4, "the controls should matter"
    assert abs(z_score(result, 1.0)) < Z_LIMIT
