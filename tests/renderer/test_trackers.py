"""Every pair of estimators, of flights and shadow rays, has one mean; marching's bias falls with its step.

Each z stays below 3.9: error probability 1e-4.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydantic import ValidationError

from weft.renderer.config import ConstantLight, DirectionalLight, OrthographicCamera, RenderConfig
from weft.renderer.kernel import KernelOptions
from weft.renderer.render import run
from weft.renderer.simple_phases import IsotropicPhase
from weft.renderer.trackers import control_sixteenths

from .statistics import Z_LIMIT, picture_mean, welch_z
from .test_transport import TABLE
from .volumes import VOXEL_MM, random_grid, uniform_grid, volume

pytestmark = pytest.mark.gl

UNBIASED = [
    ("exact", "residual_ratio"),
    ("delta", "exact"),
    pytest.param("exact", "ratio", marks=pytest.mark.proof),
    pytest.param("delta", "residual_ratio", marks=pytest.mark.proof),
]
THICK = random_grid((3, 3, 3), seed=35, peak=0.5)
FULL = random_grid((3, 3, 3), seed=36, fill=0.98, peak=0.3)
"""Of voxels nearly all of which hold fiber, as controls want it."""


def lit_once(grid, *, samples=384, seed=0, options=None, **settings):
    """Nothing is random but the first collision and the shadow ray."""
    config = RenderConfig(
        resolution=(32, 32),
        samples_per_pixel=samples,
        seed=seed,
        max_bounces=1,
        camera=OrthographicCamera(view_direction=(0.2, 0.1, 1.0), frame_width_mm=0.6),
        lights=[DirectionalLight(direction=(1, 2, 1))],
        **settings,
    )
    return run(config, volume(grid), {"a": IsotropicPhase()}, options=options)


@pytest.fixture(scope="module")
def usual():
    return lit_once(FULL, seed=99)


@pytest.mark.parametrize(("tracking", "shadows"), UNBIASED)
def test_estimators_agree_to_a_few_thousandths(usual, tracking, shadows):
    other = lit_once(FULL, tracking=tracking, shadow_tracking=shadows)
    mean, error = picture_mean(usual)
    assert error < 0.005 * mean
    assert abs(welch_z(usual, other)) < Z_LIMIT
    assert other.statistics.majorant_violations == 0


@pytest.mark.proof
def test_marching_lets_too_much_pass_and_less_so_by_shorter_steps(usual):
    """Steps of 8 voxels are off by percents, of 4 by less; half a voxel agrees."""
    mean, error = picture_mean(usual)
    excess = []
    for voxels in (8, 4, 0.5):
        result = lit_once(
            FULL, shadow_tracking="march", march_step_mm=voxels * VOXEL_MM, seed=int(4 * voxels)
        )
        excess.append((picture_mean(result)[0] - mean) / mean)
    allowed = Z_LIMIT * math.sqrt(2) * error / mean
    assert excess[0] > 2 * allowed
    assert excess[0] > excess[1] > abs(excess[2])
    assert abs(excess[2]) < allowed


def test_marching_through_an_even_block_by_one_step_has_its_closed_form():
    """Steps as long as the block, or twice as long, look once or never: over r of L with chance r/L."""
    length, sigma = 8 * VOXEL_MM, 4.0
    grid = uniform_grid((1, 1, 1), 0.02, (0.0, 1.0, 0.0))
    wall = {"extinction": "isotropic", "isotropic_extinction_per_mm": sigma / 0.02}
    for factor in (1, 2):
        config = RenderConfig(
            resolution=(32, 32),
            samples_per_pixel=128,
            seed=factor,
            max_bounces=1,
            camera=OrthographicCamera(view_direction=(1.0, 0.0, 0.0), frame_width_mm=1e-3),
            lights=[DirectionalLight(direction=(-1.0, 0.0, 0.0))],
            shadow_tracking="march",
            march_step_mm=factor * length,
            **wall,
        )
        result = run(config, volume(grid), {"a": IsotropicPhase()})
        t = (np.arange(4000) + 0.5) / 4000 * length  # of the collision; length - t is left to the light
        chance = (length - t) / (factor * length)
        passed = 1 - chance + chance * math.exp(-sigma * factor * length)
        expected = (sigma * np.exp(-sigma * t) * passed).mean() * length / (4 * math.pi)
        mean, error = picture_mean(result)
        assert abs(mean - expected) < Z_LIMIT * error


@pytest.mark.parametrize(("tracking", "shadows"), [("exact", "residual_ratio"), ("delta", "march")])
def test_no_scheduling_changes_a_bit(tracking, shadows):
    pictures = [
        lit_once(
            THICK, samples=3, tracking=tracking, shadow_tracking=shadows, options=KernelOptions(**options)
        )
        for options in ({}, {"rounds_per_dispatch": 1, "lane_count": 64, "steps_per_round": 3})
    ]
    np.testing.assert_array_equal(pictures[0].radiance, pictures[1].radiance)


def test_a_control_is_about_the_mean_of_its_brick():
    from weft.renderer.brick_pool import build_brick_pool

    pool = build_brick_pool([uniform_grid((1, 1, 1), 0.3, (1, 0, 0)), THICK])
    share = control_sixteenths(pool, projected=False)
    assert share.max() == 15  # of the even brick: its majorant, as far as 4 bits reach
    assert share.min() <= 3  # of a random one: half of its voxels are empty, few are dense


def test_what_has_no_effect_is_refused():
    with pytest.raises(ValidationError, match="march_step_mm has no effect"):
        RenderConfig(march_step_mm=0.1)
    with pytest.raises(ValidationError, match='needs tracking = "exact"'):
        RenderConfig(correlation="fibers", shadow_tracking="ratio")


@pytest.mark.proof
@pytest.mark.parametrize("shadows", ["residual_ratio"])
def test_white_furnace_by_light_sampling(shadows):
    config = RenderConfig(
        resolution=(24, 24),
        samples_per_pixel=64,
        max_bounces=10**6,
        lights=[ConstantLight()],
        background="environment",
        sampling="both_plain",
        shadow_tracking=shadows,
    )
    result = run(config, volume(random_grid((2, 2, 2), seed=21, peak=0.5)), {"a": TABLE["reference"]})
    mean, error = picture_mean(result)
    assert abs(mean - 1) < Z_LIMIT * error
