"""Light transport against theory: furnace, slabs, superposition. Error probability 1e-4 per z."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest

from weft.fiber_model.scattering.parameters import FiberScatteringParameters
from weft.fiber_model.scattering.phase import fiber_phase_eval
from weft.renderer.config import (
    ConstantLight,
    DirectionalLight,
    OrthographicCamera,
    PerspectiveCamera,
    RenderConfig,
    StudioLight,
)
from weft.renderer.render import run
from weft.renderer.scene import IsotropicPhase

from .statistics import Z_LIMIT, picture_mean, welch_z, z_score
from .volumes import (
    VOXEL_MM,
    exact_optical_depth,
    projected_extinction,
    random_grid,
    ray_pieces,
    uniform_grid,
    volume,
)

pytestmark = pytest.mark.gl

NO_LIMIT = 1_000_000


def table_row(beta_r, beta_tt, beta_trt, gamma_tt, fresnel_r, **colors):
    """A row of the thesis' table 6.1 (degrees), white unless colors are given."""
    r, tt, trt, gamma = (math.radians(v) for v in (beta_r, beta_tt, beta_trt, gamma_tt))
    return FiberScatteringParameters(r, tt, trt, gamma, (fresnel_r,) * 3, 0.85, **colors)


TABLE = {
    "reference": table_row(6, 12, 24, 220, 0.01),
    "rougher": table_row(10, 20, 40, 220, 0.01),
    "shinier": table_row(6, 12, 24, 220, 0.04),
}


def furnace(scattering, grid, *, spp=64, seed=1, **settings):
    config = RenderConfig(
        resolution=(32, 32),
        samples_per_pixel=spp,
        seed=seed,
        max_bounces=NO_LIMIT,
        camera=PerspectiveCamera(fov_deg=12, view_direction=(0.3, 0.4, 1.0)),
        lights=[ConstantLight()],
        background="environment",
        **({"sampling": "both_plain"} | settings),  # else uniform light is left to the phase function alone
    )
    return run(config, volume(grid), {"a": scattering})


SYMMETRIC = {"symmetric": dataclasses.replace(TABLE["reference"], longitudinal="symmetric")}


@pytest.mark.parametrize("name", TABLE | SYMMETRIC)
@pytest.mark.parametrize("peak", [0.02, 1.0])
def test_white_furnace(name, peak):
    """A volume that absorbs nothing cannot be seen in uniform light, thin or dense."""
    result = furnace((TABLE | SYMMETRIC)[name], random_grid((3, 3, 3), seed=21, fill=0.6, peak=peak))
    assert abs(z_score(result, 1.0)) < Z_LIMIT
    assert picture_mean(result)[1] < 0.004
    assert result.statistics.cut_paths == 0
    assert result.statistics.broken_samples == 0


def test_white_furnace_of_isotropic_scattering():
    grid = uniform_grid((2, 2, 2), 0.5, (0, 1, 0))
    result = furnace(IsotropicPhase(), grid, extinction="isotropic", isotropic_extinction_per_mm=40.0)
    assert abs(z_score(result, 1.0)) < Z_LIMIT


@pytest.mark.parametrize(
    "scattering", [TABLE["reference"], SYMMETRIC["symmetric"]], ids=["gaussian", "symmetric"]
)
def test_white_furnace_by_phase_sampling_alone_is_exact(scattering):
    """Without light sampling every path of a white fiber brings back 1: all weights are 1."""
    result = furnace(scattering, random_grid((2, 2, 2), seed=22, peak=1.0), sampling="phase", spp=4)
    np.testing.assert_allclose(result.radiance, 1.0, rtol=2e-4)


def test_uniform_light_is_not_looked_for():
    """Every scattered ray finds it, so no shadow ray is sent: a white volume brings back exactly 1."""
    result = furnace(TABLE["reference"], random_grid((2, 2, 2), seed=22, peak=1.0), sampling="both", spp=4)
    np.testing.assert_allclose(result.radiance, 1.0, rtol=2e-4)


def test_the_bounce_limit_darkens_and_is_counted():
    grid = uniform_grid((3, 3, 3), 0.8, (0, 1, 0))
    config = RenderConfig(
        resolution=(16, 16),
        samples_per_pixel=16,
        max_bounces=8,
        lights=[ConstantLight()],
        background="environment",
    )
    result = run(config, volume(grid), {"a": IsotropicPhase()})
    assert result.statistics.cut_paths > 100
    assert result.radiance.mean() < 0.99


def slab_view(scattering, grid, light_direction, *, seed=3, **settings):
    """The middle of a block seen along its x axis, lit by parallel light of irradiance 1, one bounce."""
    config = RenderConfig(
        resolution=(32, 32),
        samples_per_pixel=64,
        seed=seed,
        max_bounces=1,
        camera=OrthographicCamera(view_direction=(1.0, 0.0, 0.0), frame_width_mm=1e-3),
        lights=[DirectionalLight(direction=light_direction)],
        **settings,
    )
    return run(config, volume(grid), {"a": scattering})


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("angle_deg", [90.0, 35.0])
def test_single_scattering_in_a_slab(side, angle_deg):
    """Light along the view, reflected or shining through: one scattering has a closed form."""
    angle = math.radians(angle_deg)
    axis = np.array([math.cos(angle), math.sin(angle), 0.0])
    grid = uniform_grid((3, 2, 2), 0.02, tuple(axis))
    parameters = table_row(10, 20, 40, 60, 0.04)
    result = slab_view(parameters, grid, (side, 0.0, 0.0))
    sigma, length = projected_extinction(0.02, axis[0]), 24 * VOXEL_MM
    along = (
        (1 - math.exp(-2 * sigma * length)) / 2 if side > 0 else sigma * length * math.exp(-sigma * length)
    )
    frame = np.stack([axis, [-axis[1], axis[0], 0.0], [0.0, 0.0, 1.0]])
    phase = fiber_phase_eval(parameters, frame @ [1.0, 0, 0], frame @ [side, 0.0, 0.0])
    assert abs(z_score(result, along * float(np.asarray(phase)[..., 0]))) < Z_LIMIT


@pytest.mark.parametrize("toward", [(1.0, 1.0, 0.0), (0.2, 1.0, 0.3)])
def test_single_scattering_with_light_from_the_side(toward):
    """The shadow ray leaves through another face; depth to it is known because the view is one line."""
    grid = uniform_grid((3, 2, 2), 0.02, (0, 0, 1))
    result = slab_view(IsotropicPhase(), grid, toward)
    light = np.array(toward) / np.linalg.norm(toward)
    side = np.array([3, 2, 2]) * 8 * VOXEL_MM
    t = (np.arange(20_000) + 0.5) / 20_000 * side[0]  # depth along the view, from the face at +x
    place = np.stack([side[0] - t, np.full_like(t, side[1] / 2), np.full_like(t, side[2] / 2)], axis=1)
    leave = np.where(light > 0, (side - place) / np.where(light > 0, light, 1), np.inf).min(axis=1)
    into, out = projected_extinction(0.02, 0.0), projected_extinction(0.02, light[2])
    expected = (into * np.exp(-into * t - out * leave)).mean() * side[0] / (4 * math.pi)
    assert abs(z_score(result, expected)) < Z_LIMIT


@pytest.mark.parametrize("tracking", ["exact", "delta"])
@pytest.mark.parametrize("toward", [(0.4, 1.0, -0.7), (-0.8, -0.3, 0.6)])
def test_single_scattering_in_a_random_volume(tracking, toward):
    """Along one slanted line: collisions and shadow depths from the stored values, in numpy."""
    grid = random_grid((3, 3, 3), seed=61, peak=0.4, brick_fill=0.8)
    view = np.array([0.3, 0.5, 1.0])
    config = RenderConfig(
        resolution=(32, 32),
        samples_per_pixel=256,
        seed=4,
        max_bounces=1,
        camera=OrthographicCamera(view_direction=tuple(view), frame_width_mm=1e-5),
        lights=[DirectionalLight(direction=toward)],
        tracking=tracking,
    )
    result = run(config, volume(grid), {"a": IsotropicPhase()})
    view /= np.linalg.norm(view)
    start = volume(grid).bounds_mm.mean(axis=0) + 5 * view
    ((t, sigma),) = ray_pieces(grid, start[None], -view[None])
    # equal steps within each piece, fine enough for the shadow depth to be linear in them
    fine = np.concatenate([np.linspace(a, b, 12) for a, b in itertools.pairwise(t)])
    middle, length = (fine[1:] + fine[:-1]) / 2, np.diff(fine)
    local = sigma[np.clip(np.searchsorted(t, middle) - 1, 0, len(sigma) - 1)]
    before = np.cumsum(local * length) - local * length
    light = np.array(toward) / np.linalg.norm(toward)
    met = (local > 0) & (length > 0)
    places = start - middle[met, None] * view
    shadow = exact_optical_depth(grid, places, np.broadcast_to(light, places.shape))
    collided = np.exp(-before[met]) * -np.expm1(-local[met] * length[met])
    assert abs(z_score(result, (collided * np.exp(-shadow)).sum() / (4 * math.pi))) < Z_LIMIT


def scenery(seed=5, **settings):
    """Everything at once: narrow lobes, several kinds of light, a random volume."""
    defaults = {
        "resolution": (32, 32),
        "samples_per_pixel": 96,
        "lights": [StudioLight(), DirectionalLight(direction=(1, 2, 3), irradiance=(2, 1, 1))],
        "camera": PerspectiveCamera(view_direction=(0.3, 0.4, 1.0)),
        "roulette_start": 3,
    }
    config = RenderConfig(**(defaults | {"seed": seed} | settings))
    parameters = table_row(8, 14, 28, 40, 0.05, color_tt=(0.9, 0.5, 0.3), color_trt=(0.8, 0.4, 0.2))
    return run(config, volume(random_grid((3, 3, 3), seed=31, peak=0.5, brick_fill=0.7)), {"a": parameters})


@pytest.fixture(scope="module")
def usual():
    return scenery()


@pytest.mark.parametrize("tracking", ["exact", "delta"])
@pytest.mark.parametrize("sampling", ["both", "both_plain", "lights", "phase"])
def test_all_estimators_agree(usual, tracking, sampling):
    other = scenery(
        seed=6, tracking=tracking, sampling=sampling, samples_per_pixel=384 if sampling == "phase" else 96
    )
    for channel in range(3):
        assert abs(welch_z(usual, other, channel=channel)) < Z_LIMIT


@pytest.mark.parametrize("rng", ["philox", "sobol", pytest.param("md5", marks=pytest.mark.proof)])
def test_random_numbers_of_another_kind_make_the_same_picture(usual, rng):
    """Philox, which passes the known test batteries, against pcg4d: too weak a hash would show."""
    other = scenery(seed=5, rng=rng)
    assert not np.array_equal(usual.radiance, other.radiance)
    for channel in range(3):
        assert abs(welch_z(usual, other, channel=channel)) < Z_LIMIT


def test_shadow_estimators_agree_to_a_few_thousandths():
    """Ratio tracking against exact depth, where nothing else is random but the first collision."""
    pictures = [
        run(
            RenderConfig(
                resolution=(32, 32),
                samples_per_pixel=768,
                seed=seed,
                max_bounces=1,
                camera=OrthographicCamera(view_direction=(0.2, 0.1, 1.0), frame_width_mm=0.6),
                lights=[DirectionalLight(direction=(1, 2, 1))],
                tracking=tracking,
            ),
            volume(random_grid((3, 3, 3), seed=35, peak=0.5)),
            {"a": IsotropicPhase()},
        )
        for seed, tracking in enumerate(("exact", "delta"))
    ]
    mean, error = picture_mean(pictures[0])
    assert error < 0.002 * mean
    assert abs(welch_z(*pictures)) < Z_LIMIT


def test_russian_roulette_keeps_the_mean():
    """In a dense colored block, where half of the light comes from paths that roulette has touched."""
    grid, phase = uniform_grid((2, 2, 2), 0.8, (0, 1, 0)), {"a": IsotropicPhase((0.9, 0.6, 0.3))}
    settings = {"resolution": (32, 32), "samples_per_pixel": 128, "lights": [ConstantLight()]}
    always = run(RenderConfig(**settings, seed=1, roulette_start=1), volume(grid), phase)
    never = run(RenderConfig(**settings, seed=2, roulette_start=100_000), volume(grid), phase)
    assert always.statistics.scattering_events < 0.9 * never.statistics.scattering_events
    for channel in range(3):
        assert abs(welch_z(always, never, channel=channel)) < Z_LIMIT


def test_russian_roulette_leaves_bright_paths_alone():
    """Twenty scatterings of albedo 0.95 leave 0.36, more than a quarter."""
    grid, phase = uniform_grid((2, 2, 2), 0.8, (0, 1, 0)), {"a": IsotropicPhase((0.95, 0.5, 0.1))}
    settings = {
        "resolution": (16, 16),
        "samples_per_pixel": 8,
        "max_bounces": 20,
        "lights": [ConstantLight()],
    }
    always, never = (
        run(RenderConfig(**settings, roulette_start=start), volume(grid), phase) for start in (1, 100_000)
    )
    assert always.statistics.cut_paths > 0
    np.testing.assert_array_equal(always.radiance, never.radiance)


def two_media(one, two, scattering, seed):
    config = RenderConfig(
        resolution=(32, 32),
        samples_per_pixel=64,
        seed=seed,
        lights=[ConstantLight(), DirectionalLight(direction=(1, 1, 1))],
    )
    return run(config, volume(one, two), scattering)


def test_two_half_densities_are_one():
    whole = random_grid((3, 2, 2), seed=41, peak=0.3)
    half = dataclasses.replace(whole, density=whole.density / 2)
    scattering = table_row(8, 14, 28, 60, 0.05)
    config = RenderConfig(
        resolution=(32, 32),
        samples_per_pixel=64,
        seed=1,
        lights=[ConstantLight(), DirectionalLight(direction=(1, 1, 1))],
    )
    one = run(config, volume(whole), {"a": scattering})
    two = two_media(half, half, {"a": scattering, "b": scattering}, seed=2)
    assert abs(welch_z(one, two)) < Z_LIMIT
    assert np.isclose(one.layers["A"].mean(), two.layers["A"].mean(), atol=0.01)


def test_the_order_of_media_does_not_matter():
    red, blue = IsotropicPhase((0.9, 0.1, 0.1)), IsotropicPhase((0.1, 0.1, 0.9))
    warp, weft = random_grid((2, 2, 2), seed=42), random_grid((2, 2, 3), seed=43, brick_fill=0.6)
    first = two_media(warp, weft, {"a": red, "b": blue}, seed=1)
    second = two_media(weft, warp, {"a": blue, "b": red}, seed=2)
    for channel in (0, 2):
        assert abs(welch_z(first, second, channel=channel)) < Z_LIMIT
    assert abs(picture_mean(first)[0] - picture_mean(first, channel=2)[0]) > 0.01


@pytest.mark.parametrize("axis", [0, 1])
def test_media_that_never_meet_keep_their_colors_and_places(axis):
    """Red bricks on the left or below, blue ones on the right or above, as the camera must show them."""
    one = uniform_grid((2, 2, 2), 0.3, (0, 1, 0))
    apart = np.zeros(3, np.int32)
    apart[axis] = 32
    other = dataclasses.replace(one, origins=one.origins + apart)
    config = RenderConfig(
        resolution=(32, 32),
        samples_per_pixel=16,
        lights=[ConstantLight()],
        camera=PerspectiveCamera(view_direction=(0, 0, 1)),
    )
    result = run(config, volume(one, other), {"a": IsotropicPhase((1, 0, 0)), "b": IsotropicPhase((0, 0, 1))})
    picture = result.radiance if axis == 0 else np.rot90(result.radiance, -1)
    assert picture[:, :15, 0].max() > 0.1
    assert picture[:, :15, 2].max() == 0
    assert picture[:, -15:, 2].max() > 0.1
    assert picture[:, -15:, 0].max() == 0


def test_light_adds_up():
    """A picture under several lights is the sum of the pictures under each."""
    lights = [
        StudioLight(),
        DirectionalLight(direction=(1, 2, 3), irradiance=(2, 1, 1)),
        DirectionalLight(direction=(-1, 0.2, -1), irradiance=(1, 1, 5)),
    ]
    together = scenery(seed=1, lights=lights)
    parts = [scenery(seed=2 + i, lights=[light]) for i, light in enumerate(lights)]
    for channel in range(3):
        means, errors = np.array([picture_mean(part, channel=channel) for part in parts]).T
        mean, error = picture_mean(together, channel=channel)
        assert abs(mean - means.sum()) < Z_LIMIT * math.hypot(error, *errors)


def test_edges_are_smoothed():
    """Samples spread over their pixel, so the silhouette of an opaque block is gray."""
    block = uniform_grid((2, 2, 2), 500.0, (0, 1, 0))
    config = RenderConfig(
        resolution=(16, 16),
        samples_per_pixel=64,
        lights=[ConstantLight()],
        camera=OrthographicCamera(view_direction=(0.2, 0.1, 1.0)),
    )
    opacity = run(config, volume(block), {"a": IsotropicPhase((0, 0, 0))}).layers["A"]
    assert (opacity == 1).any()
    assert (opacity == 0).any()
    assert ((opacity > 0.1) & (opacity < 0.9)).sum() > 10


def test_self_shadow_offset_skips_its_length():
    """Back-scattered light in a slab, with the first 0.2 mm of every shadow ray free of extinction."""
    grid = uniform_grid((3, 2, 2), 0.02, (0, 1, 0))
    result = slab_view(IsotropicPhase(), grid, (1.0, 0.0, 0.0), self_shadow_offset_fibers=20.0)
    sigma, length, skip = projected_extinction(0.02, 0.0), 24 * VOXEL_MM, 20 * grid.fiber_radius_mm
    z = (np.arange(100_000) + 0.5) / 100_000 * length
    expected = (sigma * np.exp(-sigma * z - sigma * np.maximum(z - skip, 0))).mean() * length / (4 * math.pi)
    assert abs(z_score(result, expected)) < Z_LIMIT
