"""Places on area lights: chosen with the density that is claimed, about evenly. 1e-4 per test."""

from __future__ import annotations

from statistics import NormalDist

import numpy as np
import pytest

from weft.renderer.config import ConstantLight, PerspectiveCamera, RenderConfig
from weft.renderer.light_config import DiskLight, MeshLight, QuadLight, SoftboxLight
from weft.renderer.local_lights import LocalLight, Stage, light_rows, local_lights, softbox_quad
from weft.renderer.render import run
from weft.renderer.scene import IsotropicPhase
from weft.renderer.surface_config import GroundSurface, Placement

from .probe import probe
from .statistics import Z_LIMIT, welch_z, z_score
from .test_local_lights import COLOR, SPOT, corner_irradiance, seen_from_above
from .test_transport import TABLE
from .volumes import random_grid, volume

pytestmark = pytest.mark.gl

SAMPLES = 60_000
PARTS = 5
DISK = DiskLight(position_mm=(1, 4, 2), target_mm=(1.5, 0, 3), radius_mm=2, radiance=(1, 1, 1))
X, Y = np.array([3.0, 0, 0.2]), np.array([0.5, 0.3, 2.0])
NORMAL = np.cross(X, Y) / np.linalg.norm(np.cross(X, Y))
TRIANGLE = LocalLight("triangle", np.array([-0.5, 4.0, 1.0]), np.ones(3), NORMAL, X, Y)
BELOW = [(1, 0, 2), (0.5, 3.2, 2.5), (5, 1, 3), (40, -30, 10), (1.2, 3.9, 2.2), (-4, 3.4, 0)]
"""Seen from below, from close by, aslant, from far away, from almost in its plane."""


def places(light: LocalLight, u: np.ndarray) -> np.ndarray:
    """Of points of the unit square, even in area."""
    if light.kind == "triangle":
        r = np.sqrt(u[:, :1])
        return light.center + (1 - r) * light.half_x + r * u[:, 1:] * light.half_y
    r, phi = np.sqrt(u[:, :1]), 2 * np.pi * u[:, 1:]
    return light.center + r * np.cos(phi) * light.half_x + r * np.sin(phi) * light.half_y


def unit_square(light: LocalLight, place: np.ndarray) -> np.ndarray:
    """The inverse of `places`."""
    d = place - light.center
    axes = np.stack([light.half_x, light.half_y], axis=1)
    x, y = np.linalg.lstsq(axes, d.T, rcond=None)[0]
    if light.kind == "triangle":
        root = 1 - x
        return np.stack([root**2, y / root], axis=1)
    return np.stack([x**2 + y**2, np.arctan2(y, x) / (2 * np.pi) % 1], axis=1)


def solid_angles(light: LocalLight, point: np.ndarray, fine: int = 240) -> np.ndarray:
    """Of PARTS x PARTS parts of the light, by quadrature over its area, float64."""
    n = PARTS * fine
    grid = (np.stack(np.meshgrid(np.arange(n), np.arange(n), indexing="ij"), -1).reshape(-1, 2) + 0.5) / n
    away = places(light, grid) - point
    distance = np.linalg.norm(away, axis=1)
    seen = light.area / n**2 * np.abs(away @ light.normal) / distance**3
    return seen.reshape(PARTS, fine, PARTS, fine).sum(axis=(1, 3))


@pytest.fixture(scope="module", params=["disk", "triangle"])
def shape(request):
    """A light, and what samples it and gives the density on the device."""
    light = TRIANGLE if request.param == "triangle" else local_lights([DISK], Stage(np.zeros(3)))[0]
    common = {
        "constants": {"LOCAL_QUADS": 0}
        | {f"LOCAL_{n.upper()}S": n == light.kind for n in ("disk", "triangle")},
        "prelude": "layout(std430, binding = 2) readonly buffer L { vec4 lights[]; };\n"
        "uniform uint local_lights;",
        "blocks": {2: light_rows([light], np.zeros(3), 1.0)},
        "uniforms": {"local_lights": 0},
    }
    sample = probe(
        "light/local.glsl",
        "vec3 local_light_sample(uint light, vec3 value, vec3 point, vec2 u, out vec3 direction, "
        "out float distance, out float pdf)",
        **common,
    )
    density = probe("light/local.glsl", "float local_light_pdf(uint light, vec3 point, vec3 away)", **common)
    yield light, sample, density
    sample.program = density.program = None


@pytest.mark.parametrize("point", BELOW)
def test_samples_follow_their_density_and_lie_on_the_light(shape, point):
    """In every part of the light the mean of 1/density is the part's solid angle; and density is what a ray
    that meets the place would find.
    """
    light, sample, density = shape
    u = np.random.default_rng(3).random((SAMPLES, 2), dtype=np.float32)
    value, direction, distance, pdf = (x.astype(float) for x in sample(0, (1, 1, 1), point, u))
    place = point + direction * distance[:, None]
    off = np.abs((place - light.center) @ light.normal)
    assert off.max() < 1e-4 * (1 + distance.max())
    at = unit_square(light, place)
    assert at.min() > -1e-3
    assert at.max() < 1 + 1e-3
    part = np.clip((at * PARTS).astype(int), 0, PARTS - 1) @ [PARTS, 1]
    exact = solid_angles(light, np.array(point, float)).ravel()
    first = np.bincount(part, 1 / pdf, PARTS**2) / SAMPLES
    second = np.bincount(part, 1 / pdf**2, PARTS**2) / SAMPLES
    z = (first - exact) / np.sqrt((second - first**2) / SAMPLES)
    assert np.abs(z).max() < NormalDist().inv_cdf(1 - 1e-4 / 2 / PARTS**2)
    error = Z_LIMIT * (1 / pdf).std() / np.sqrt(SAMPLES) + 3e-4 * exact.sum()
    assert abs(first.sum() - exact.sum()) < error
    again = density(0, point, direction * distance[:, None])
    assert np.median(np.abs(again / pdf - 1)) < 2e-4
    assert np.quantile(np.abs(again / pdf - 1), 0.999) < 0.02
    bright = (np.array(point) - light.center) @ light.normal > 0
    np.testing.assert_allclose(value[:, 0] * pdf, float(bright), rtol=1e-5)


@pytest.mark.parametrize("shape", ["disk"], indirect=True)
@pytest.mark.parametrize(("point", "spread"), [((1, 0, 2), 1e-3), ((5, 1, 3), 0.02), ((1.2, 3.6, 2.2), 0.05)])
def test_a_disk_is_sampled_evenly_in_solid_angle(shape, point, spread):
    _, sample, _ = shape
    u = np.random.default_rng(4).random((SAMPLES, 2), dtype=np.float32)
    pdf = sample(0, (1, 1, 1), point, u)[3].astype(float)
    assert (1 / pdf).std() < spread * (1 / pdf).mean()


def write_mesh(folder, vertices, faces, name):
    lines = [f"v {x} {y} {z}" for x, y, z in vertices] + [f"f {a} {b} {c}" for a, b, c in faces]
    (folder / name).write_text("\n".join(lines))
    return folder / name


@pytest.mark.parametrize("sampling", ["both", "phase"])
@pytest.mark.parametrize("height", [0.3, 30.0])
def test_a_mesh_of_two_triangles_gives_the_closed_form_of_the_quad(tmp_path, sampling, height):
    """Seen from below one of its corners; it faces down."""
    file = write_mesh(tmp_path, [(0, 0, 0), (3, 0, 0), (3, 0, 2), (0, 0, 2)], [(1, 2, 3), (1, 3, 4)], "q.obj")
    place = Placement(position_mm=(SPOT[0], height, SPOT[2]))
    light = MeshLight(file=file, placement=place, radiance=(1, 2, 3))
    result = seen_from_above([light], sampling=sampling, seed=8)
    expected = COLOR * np.array([1, 2, 3]) * corner_irradiance(3, 2, height) / np.pi
    assert abs(z_score(result, expected[1], channel=1)) < Z_LIMIT


def test_a_bright_box_is_six_quads(tmp_path):
    """As a mesh of twelve triangles, beside fibers and over a ground."""
    import trimesh

    box = trimesh.creation.box(extents=(0.6, 0.2, 0.3))
    box.export(tmp_path / "box.ply")
    at = np.array([0.5, 0.8, 0.9])
    mesh = MeshLight(
        file=tmp_path / "box.ply", placement=Placement(position_mm=tuple(at)), radiance=(4.0, 3.0, 2.0)
    )
    quads = []
    for axis, sign in ((a, s) for a in range(3) for s in (-1, 1)):
        out, size = np.eye(3)[axis] * sign, np.array([0.6, 0.2, 0.3])
        up = (axis + 1) % 3
        across = 3 - axis - up
        quads.append(
            QuadLight(
                position_mm=tuple(at + out * size / 2),
                target_mm=tuple(at + 9 * out),
                up=tuple(np.eye(3)[up]),
                width_mm=size[across],
                height_mm=size[up],
                radiance=(4.0, 3.0, 2.0),
            )
        )
    one, two = (
        run(
            RenderConfig(
                resolution=(20, 20),
                samples_per_pixel=256,
                seed=seed,
                lights=lights,
                surfaces=[GroundSurface(size_mm=10)],
                camera=PerspectiveCamera(view_direction=(0.3, 0.7, 1.0), frame_width_mm=2.5),
            ),
            volume(random_grid((2, 1, 2), seed=5, fill=0.3)),
            {"a": TABLE["reference"]},
        )
        for seed, lights in enumerate(([mesh], quads))
    )
    for channel in range(3):
        assert abs(welch_z(one, two, channel=channel)) < Z_LIMIT


def test_a_softbox_gives_its_irradiance_whatever_its_size():
    """On a surface in the middle that faces it: by quadrature over the quad that it is."""
    stage = Stage(np.array([1.0, 2.0, 3.0]), 5.0, np.eye(3)[[2, 1, 0]] * [[1], [1], [-1]])
    for size in ((None, None), (30.0, 2.0)):
        box = SoftboxLight(width_mm=size[0], height_mm=size[1], irradiance=(1, 2, 3))
        (light,) = local_lights([softbox_quad(box, stage)], stage)
        assert np.linalg.norm(light.center - stage.middle_mm) == pytest.approx(10)
        grid = np.stack(np.meshgrid(*[(np.arange(300) + 0.5) / 150 - 1] * 2), -1).reshape(-1, 2)
        away = light.center + grid @ np.stack([light.half_x, light.half_y]) - stage.middle_mm
        squared = (away**2).sum(axis=1)
        cosine = -(away @ light.normal)
        measured = light.area / len(grid) * (cosine**2 / squared**2).sum() * light.value
        np.testing.assert_allclose(measured, (1, 2, 3), rtol=1e-4)


def test_softboxes_stand_around_the_camera():
    """Left of and above the view by default."""
    axes = np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]])  # the camera looks along -x
    quad = softbox_quad(SoftboxLight(distance_mm=10), Stage(np.zeros(3), 1.0, axes))
    np.testing.assert_allclose(np.array(quad.position_mm) @ axes.T, [-5, 10 * np.sqrt(0.5), 5], atol=1e-9)


def test_a_scene_of_all_local_lights_is_finite():
    lights = [
        DISK,
        SoftboxLight(distance_mm=5),
        ConstantLight(radiance=(0.1, 0.1, 0.1)),
    ]
    grid = volume(random_grid((1, 1, 1), seed=5, fill=0.5))
    config = RenderConfig(resolution=(12, 12), samples_per_pixel=16, lights=lights)
    result = run(config, grid, {"a": IsotropicPhase()})
    assert result.statistics.broken_samples == 0
    assert np.isfinite(result.radiance).all()
    assert result.radiance.max() > 0
