"""Lights that stand somewhere: even in solid angle, with the irradiance of closed forms. 1e-4 per z."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydantic import ValidationError
from scipy import stats

from weft.files.errors import InputError
from weft.renderer.config import ConstantLight, OrthographicCamera, PerspectiveCamera, RenderConfig
from weft.renderer.kernel import KernelOptions
from weft.renderer.light_config import DiskLight, PointLight, QuadLight, SpotLight
from weft.renderer.local_lights import Stage, light_rows, local_lights
from weft.renderer.render import run
from weft.renderer.scene import IsotropicPhase
from weft.renderer.surface_config import DiffuseMaterial, GroundSurface

from .probe import probe
from .statistics import Z_LIMIT, picture_mean, welch_z, z_score
from .test_transport import TABLE
from .volumes import projected_extinction, random_grid, uniform_grid, volume

SPECK = volume(uniform_grid((1, 1, 1), 0.5, (1, 0, 0)))
"""A volume of 0.4 mm at the origin, out of the way of what is tested."""
COLOR = np.array([0.2, 0.5, 0.8])
GROUND = GroundSurface(material=DiffuseMaterial(color=tuple(COLOR)), size_mm=100)
SPOT = (20.0, 0.0, 20.0)
"""A place on the ground, whose height is 0."""
QUAD = QuadLight(
    position_mm=(1, 4, 2), target_mm=(1, 0, 2), up=(0, 0, 1), width_mm=3, height_mm=2, radiance=(1, 1, 1)
)


def seen_from_above(lights, *, seed=2, spp=256, **settings):
    """Mean radiance of a small part of the ground around SPOT, after one bounce, from below the lights."""
    camera = PerspectiveCamera(position_mm=(10, 1, 20), target_mm=SPOT, fov_deg=5e-4)
    config = RenderConfig(
        resolution=(16, 16),
        samples_per_pixel=spp,
        seed=seed,
        max_bounces=2,
        camera=camera,
        lights=lights,
        surfaces=[GROUND],
        **settings,
    )
    return run(config, SPECK, {"a": IsotropicPhase()})


def above(height, dx=0.0):
    return (SPOT[0] + dx, height, SPOT[2])


@pytest.mark.gl
def test_a_point_light_falls_with_the_square_of_the_distance():
    light = PointLight(position_mm=above(3.0, dx=4.0), intensity=(50, 100, 200))
    result = seen_from_above([light], spp=4)
    irradiance = np.array([50, 100, 200]) / 25 * (3 / 5)
    expected = np.broadcast_to(COLOR / math.pi * irradiance, (16, 16, 3))
    np.testing.assert_allclose(result.radiance, expected, rtol=2e-3)  # the view is a micrometer long


@pytest.mark.gl
@pytest.mark.parametrize(("angle_deg", "share"), [(10, 1.0), (24, 0.6), (31, 0.0)])
def test_a_spot_fades_evenly_from_its_beam_to_its_edge(angle_deg, share):
    dx = 5 * math.tan(math.radians(angle_deg))
    light = SpotLight(
        position_mm=above(5.0, dx=dx),
        target_mm=above(0.0, dx=dx),
        intensity=(25, 25, 25),
        beam_deg=20,
        cutoff_deg=30,
    )
    cosine = math.cos(math.radians(angle_deg))
    expected = np.broadcast_to(COLOR / math.pi * cosine**3 * share, (16, 16, 3))
    np.testing.assert_allclose(seen_from_above([light], spp=4).radiance, expected, rtol=2e-3, atol=1e-7)


@pytest.mark.gl
@pytest.mark.parametrize("sampling", ["both", "lights", "phase"])
@pytest.mark.parametrize("height", [0.5, 4.0, 40.0])
def test_a_disk_overhead_gives_its_closed_form(sampling, height):
    """E = pi L r² / (r² + h²) on its axis."""
    radius = 2.0
    light = DiskLight(position_mm=above(height), target_mm=SPOT, radius_mm=radius, radiance=(1, 2, 3))
    result = seen_from_above([light], sampling=sampling)
    expected = COLOR * np.array([1, 2, 3]) * radius**2 / (radius**2 + height**2)
    for channel in range(3):
        assert abs(z_score(result, expected[channel], channel=channel)) < Z_LIMIT
    if sampling != "phase":
        assert picture_mean(result)[1] < 0.004 * expected[0]


def corner_irradiance(a, b, h):
    """On a plane parallel to a rectangle a x b, below its corner, at radiance 1 (Howell, catalog C-3)."""
    x, y = a / h, b / h
    return 0.5 * (
        x / math.sqrt(1 + x * x) * math.atan(y / math.sqrt(1 + x * x))
        + y / math.sqrt(1 + y * y) * math.atan(x / math.sqrt(1 + y * y))
    )


@pytest.mark.gl
@pytest.mark.parametrize("sampling", ["both", "lights", "phase"])
@pytest.mark.parametrize("height", [0.3, 2.0, 30.0])
def test_a_quad_overhead_gives_its_closed_form(sampling, height):
    """Seen from below one of its corners."""
    middle = (SPOT[0] + 1.5, height, SPOT[2] + 1.0)
    light = QuadLight(
        position_mm=middle,
        target_mm=(middle[0], 0, middle[2]),
        up=(0, 0, 1),
        width_mm=3,
        height_mm=2,
        radiance=(1, 1, 1),
    )
    result = seen_from_above([light], sampling=sampling, seed=7)
    expected = COLOR * corner_irradiance(3, 2, height) / math.pi
    assert abs(z_score(result, expected[2], channel=2)) < Z_LIMIT
    if sampling != "phase":
        assert picture_mean(result, channel=2)[1] < 0.004 * expected[2]


@pytest.mark.gl
@pytest.mark.parametrize("point", [(1, 3, 2), (0.5, 3.99, 2.5), (5, 1, 3), (40, -30, 10), (2.4, 3.5, 3.2)])
def test_samples_of_a_quad_are_even_in_solid_angle(point):
    """Parts of the quad get samples in proportion to their solid angle or, where it is small, their area."""
    light = local_lights([QUAD], Stage(np.zeros(3)))[0]
    signature = (
        "vec3 local_light_sample(uint light, vec3 value, vec3 point, vec2 u, out vec3 direction, "
        "out float distance, out float pdf)"
    )
    call = probe(
        "light/local.glsl",
        signature,
        constants={"LOCAL_QUADS": 1, "LOCAL_DISKS": 0, "LOCAL_TRIANGLES": 0},
        prelude="layout(std430, binding = 2) readonly buffer L { vec4 lights[]; };\n"
        "uniform uint local_lights;",
        blocks={2: light_rows([light], np.zeros(3), 1.0)},
        uniforms={"local_lights": 0},
    )
    u = np.random.default_rng(3).random((100_000, 2), dtype=np.float32)
    value, direction, distance, pdf = (x.astype(float) for x in call(0, (1, 1, 1), point, u))
    places = point + direction * distance[:, None]
    np.testing.assert_allclose(places[:, 1], 4, atol=2e-5 * (1 + distance.max()))
    parts = 6
    local = np.stack([(places - light.center) @ h / (h @ h) for h in (light.half_x, light.half_y)], axis=-1)
    assert np.abs(local).max() < 1 + 1e-4
    counts = np.histogram2d(*np.clip(local, -1, 1).T, bins=parts, range=[[-1, 1]] * 2)[0]
    edges = np.linspace(-1, 1, parts + 1)
    d = light.center - np.array(point)
    x, y = (d @ h / np.linalg.norm(h) + edges * np.linalg.norm(h) for h in (light.half_x, light.half_y))
    height = abs(d @ light.normal)
    corner = np.arctan2(np.outer(x, y), height * np.sqrt(np.add.outer(x**2, y**2) + height**2))
    solid = np.diff(np.diff(corner, axis=0), axis=1)  # of each part, from those below its corners
    # where the density is not even it is that of the area: the same in every part
    even = pdf.std() < 1e-3 * pdf.mean()
    share = solid / solid.sum() if even else np.full_like(solid, 1 / parts**2)
    assert stats.chisquare(counts.ravel(), share.ravel() * len(u)).pvalue > 1e-4
    np.testing.assert_allclose((1 / pdf).mean(), solid.sum(), rtol=0.01 if not even else 1e-3)
    bright = (np.array(point) - light.center) @ light.normal > 0
    np.testing.assert_allclose(value[:, 0] * pdf, float(bright), rtol=1e-5)


@pytest.mark.gl
def test_light_inside_of_a_volume_is_dimmed_by_what_lies_between():
    """A point light in the middle of a black slab, and the ground below it."""
    density = 0.05
    grid = volume(uniform_grid((4, 1, 4), density, (1, 0, 0)))  # 1.6 x 0.4 x 1.6 mm, from the ground up
    ground = GroundSurface(material=DiffuseMaterial(color=(1, 1, 1)), size_mm=100)
    config = RenderConfig(
        resolution=(16, 16),
        samples_per_pixel=1024,
        max_bounces=1,
        camera=OrthographicCamera(position_mm=(0.8, 9, 0.8), target_mm=(0.8, 0, 0.8), frame_width_mm=1e-3),
        lights=[PointLight(position_mm=(0.8, 0.225, 0.8), intensity=(1, 1, 1))],  # halfway through a voxel
        surfaces=[ground],
    )
    result = run(config, grid, {"a": IsotropicPhase((0, 0, 0))})
    sigma = projected_extinction(density, 0.0)
    expected = math.exp(-sigma * 0.4) * math.exp(-sigma * 0.225) / 0.225**2 / math.pi
    assert abs(z_score(result, expected)) < Z_LIMIT
    assert picture_mean(result)[1] < 0.01 * expected


@pytest.mark.gl
def test_an_area_light_is_seen_from_its_front_only():
    light = DiskLight(position_mm=(20, 20, 20), target_mm=(20, 20, 30), radius_mm=2, radiance=(3, 4, 5))
    seen = []
    for z in (60.0, -60.0):
        camera = PerspectiveCamera(position_mm=(20, 20, z), target_mm=(20, 20, 20), fov_deg=1)
        config = RenderConfig(resolution=(4, 4), samples_per_pixel=2, camera=camera, lights=[light])
        seen.append(run(config, SPECK, {"a": IsotropicPhase()}).radiance)
    np.testing.assert_allclose(seen[0], np.broadcast_to([3, 4, 5], (4, 4, 3)), rtol=1e-6)
    assert not seen[1].any()


@pytest.mark.gl
def test_how_lights_are_found_does_not_change_the_mean():
    grid = volume(random_grid((2, 2, 2), seed=5, fill=0.5))
    lights = [
        QuadLight(position_mm=(0.4, 1.2, 0.4), width_mm=0.8, height_mm=0.5, radiance=(3, 2, 1)),
        DiskLight(position_mm=(1.6, 0.3, 0.4), radius_mm=0.4, radiance=(1, 2, 3)),
        ConstantLight(radiance=(0.2, 0.2, 0.2)),
    ]
    pictures = [
        run(
            RenderConfig(
                resolution=(24, 24),
                samples_per_pixel=256,
                seed=seed,
                lights=lights,
                sampling=sampling,
                tracking=tracking,
                surfaces=[GroundSurface(size_mm=10)],
                camera=PerspectiveCamera(view_direction=(0.3, 0.7, 1.0)),
            ),
            grid,
            {"a": TABLE["reference"]},
        )
        for seed, (sampling, tracking) in enumerate(
            [("both", "exact"), ("lights", "exact"), ("phase", "exact"), ("both", "delta")]
        )
    ]
    for other in pictures[1:]:
        assert abs(welch_z(pictures[0], other, channel=1)) < Z_LIMIT


@pytest.mark.gl
def test_no_scheduling_changes_a_bit():
    config = RenderConfig(
        resolution=(12, 12),
        samples_per_pixel=3,
        lights=[QUAD, PointLight(position_mm=(3, 3, 3), intensity=(9, 9, 9))],
        camera=PerspectiveCamera(view_direction=(0.3, 0.7, 1.0)),
    )
    grid = volume(random_grid((2, 2, 2), seed=5, fill=0.5))
    one, two = (
        run(config, grid, {"a": TABLE["reference"]}, options=KernelOptions(**options))
        for options in ({}, {"rounds_per_dispatch": 1, "seeks_per_round": 1, "lane_count": 64})
    )
    np.testing.assert_array_equal(one.radiance, two.radiance)


def test_lights_that_cannot_be_are_refused():
    with pytest.raises(ValidationError, match="greater than 0"):
        DiskLight(position_mm=(0, 1, 0), radius_mm=0, radiance=(1, 1, 1))
    with pytest.raises(ValidationError, match=r"beam_deg 30.0 must be smaller than cutoff_deg 20.0"):
        SpotLight(position_mm=(0, 1, 0), intensity=(1, 1, 1), beam_deg=30)
    aimed_at_itself = DiskLight(position_mm=(0, 1, 0), radius_mm=1, radiance=(1, 1, 1))
    with pytest.raises(InputError, match="a disk light stands at its target"):
        local_lights([aimed_at_itself], Stage(np.array([0.0, 1.0, 0.0])))
