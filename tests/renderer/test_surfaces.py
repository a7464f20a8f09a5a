"""Surfaces: rays find the nearest one, light on it is that of theory, alone and with a volume. 1e-4 per z."""

from __future__ import annotations

import math

import numpy as np
import pytest
from PIL import Image
from pydantic import ValidationError
from scipy import stats

from weft.renderer.balls import ball_triangles, sweep_balls
from weft.renderer.config import (
    ConstantLight,
    DirectionalLight,
    OrthographicCamera,
    PerspectiveCamera,
    RenderConfig,
    StudioLight,
)
from weft.renderer.kernel import KernelOptions
from weft.renderer.materials import read_texture
from weft.renderer.mesh import load_mesh
from weft.renderer.render import run
from weft.renderer.scene import IsotropicPhase
from weft.renderer.surface_config import (
    BallSurface,
    DiffuseMaterial,
    GroundSurface,
    MeshSurface,
    Placement,
    PrincipledMaterial,
    SweepRow,
    SweepSurface,
)

from .meshes import first_hits, write_ball
from .probe import probe
from .statistics import Z_LIMIT, picture_mean, welch_z, z_score
from .test_transport import TABLE
from .volumes import projected_extinction, random_grid, uniform_grid, volume

pytestmark = pytest.mark.gl

WHITE = DiffuseMaterial(color=(1, 1, 1))
SPECK = volume(uniform_grid((1, 1, 1), 0.5, (1, 0, 0)))
"""A volume of 0.4 mm at the origin, out of the way of what is tested."""


def render(surfaces, grid=SPECK, scattering=None, **settings):
    defaults = {"resolution": (16, 16), "samples_per_pixel": 64, "seed": 4, "lights": [ConstantLight()]}
    config = RenderConfig(surfaces=surfaces, **(defaults | settings))
    return run(config, grid, {"a": scattering or IsotropicPhase()})


def looking_down(*, width=1.0, middle=(10.0, 0.0, 10.0)):
    """A parallel camera above the ground, away from the volume."""
    above = (middle[0], middle[1] + 20, middle[2])
    return OrthographicCamera(position_mm=above, target_mm=middle, frame_width_mm=width)


@pytest.mark.parametrize("suffix", ["obj", "ply", "glb", "stl"])
def test_depth_is_that_of_the_nearest_triangle(tmp_path, suffix):
    """Two balls of 320 triangles, one turned, against all triangles tried in float64."""
    file = write_ball(tmp_path, name=f"ball.{suffix}")
    places = [
        Placement(position_mm=(5, 0, 0), scale=0.7),
        Placement(position_mm=(6, 1, -2), rotation_deg=(20, 50, 70)),
    ]
    camera = OrthographicCamera(position_mm=(8, 6, 9), target_mm=(5.5, 0.5, -1), frame_width_mm=3.5)
    surface = MeshSurface(file=file, placements=places, material=WHITE)
    n = 48
    picture = render([surface], camera=camera, resolution=(n, n), samples_per_pixel=1, max_bounces=1)
    from weft.renderer.camera import place_camera
    from weft.renderer.mesh import mesh_triangles

    frame = place_camera(camera, SPECK.bounds_mm, (n, n))
    x, y = np.meshgrid((np.arange(n) + 0.5) / n * 2 - 1, -((np.arange(n) + 0.5) / n * 2 - 1))
    origins = frame.position + x[..., None] * frame.right + y[..., None] * frame.up
    corners = mesh_triangles(surface, 0).corners
    exact = first_hits(corners, origins.reshape(-1, 3), frame.forward).reshape(n, n)
    depth = picture.layers["Z"].astype(float)
    both = np.isfinite(depth) & np.isfinite(exact)
    assert both.sum() > 400
    # samples lie anywhere in their pixel: compare where the neighborhood is level
    assert (np.isfinite(depth) == np.isfinite(exact)).mean() > 0.93
    assert np.median(np.abs(depth[both] - exact[both])) < 0.02
    facing = np.abs(np.stack([picture.layers[f"N.{c}"] for c in "XYZ"], -1)[both] @ frame.forward)
    assert facing.min() > 0


@pytest.mark.parametrize("sampling", ["both_plain", "lights", "phase"])
@pytest.mark.parametrize("smooth", [True, False])
def test_white_furnace(tmp_path, sampling, smooth):
    """A white ball cannot be seen in uniform light; with smooth normals it loses what they send inward."""
    surface = MeshSurface(
        file=write_ball(tmp_path),
        smooth=smooth,
        material=WHITE,
        placements=[Placement(position_mm=(5, 0, 0))],
    )
    camera = PerspectiveCamera(position_mm=(5, 4, 9), target_mm=(5, 0, 0), fov_deg=16)
    result = render([surface], camera=camera, sampling=sampling, background="environment")
    if smooth:
        assert 0.99 < result.radiance.mean() < 1.01
    elif sampling == "phase":
        np.testing.assert_allclose(result.radiance, 1, rtol=1e-5)
    else:
        assert abs(z_score(result, 1.0)) < Z_LIMIT


def test_white_furnace_of_a_white_volume_on_a_white_ground():
    """Light goes back and forth between fibers and ground, many times, and none is lost."""
    grid = volume(random_grid((3, 3, 2), seed=21, fill=0.6, peak=1.0))
    ground = GroundSurface(normal=(0, 0, 1), material=WHITE)
    result = render(
        [ground],
        grid,
        TABLE["reference"],
        camera=PerspectiveCamera(fov_deg=12, view_direction=(0.3, 0.4, 1.0)),
        resolution=(32, 32),
        background="environment",
        max_bounces=1_000_000,
        sampling="both_plain",
    )
    assert abs(z_score(result, 1.0)) < Z_LIMIT
    assert picture_mean(result)[1] < 0.004
    assert result.statistics.broken_samples == 0


@pytest.mark.parametrize("angle_deg", [0.0, 50.0, 85.0])
def test_parallel_light_on_the_ground(angle_deg):
    """Radiance is color / pi times the irradiance, by the cosine of the light's angle."""
    angle = math.radians(angle_deg)
    light = DirectionalLight(direction=(math.sin(angle), math.cos(angle), 0), irradiance=(3, 2, 1))
    ground = GroundSurface(material=DiffuseMaterial(color=(0.2, 0.5, 0.8)), size_mm=100)
    result = render([ground], lights=[light], camera=looking_down())
    expected = np.array([0.2 * 3, 0.5 * 2, 0.8 * 1]) * math.cos(angle) / math.pi
    np.testing.assert_allclose(result.radiance, np.broadcast_to(expected, (16, 16, 3)), rtol=1e-4)


def test_light_through_a_volume_reaches_the_ground_by_its_transmittance():
    """A black slab over the ground, seen from below the slab's edge by a camera that looks past it."""
    density = 0.02
    grid = volume(uniform_grid((4, 1, 4), density, (1, 0, 0)))  # 1.6 x 0.4 x 1.6 mm
    ground = GroundSurface(material=WHITE, gap_mm=2.0, size_mm=100)
    light = DirectionalLight(direction=(0, 1, 0))
    shadow = looking_down(width=0.2, middle=(0.8, -2.0, 0.8))
    settings = {"lights": [light], "max_bounces": 1, "camera": shadow, "samples_per_pixel": 256}
    result = render([ground], grid, IsotropicPhase((0, 0, 0)), **settings)
    transmittance = math.exp(-0.4 * projected_extinction(density, 0.0))
    assert 0.3 < transmittance < 0.8
    # through the slab twice: the light on its way down, and the camera's ray
    assert abs(z_score(result, transmittance**2 / math.pi)) < Z_LIMIT
    assert picture_mean(result)[1] < 0.002


@pytest.mark.parametrize("tracking", ["exact", "delta"])
def test_a_surface_inside_of_a_volume_ends_the_fibers(tracking):
    """A ground halfway through a voxel of a black slab, lit and seen through the 0.275 mm above it."""
    density = 0.02
    grid = volume(uniform_grid((4, 1, 4), density, (1, 0, 0)))
    result = render(
        [GroundSurface(material=WHITE, gap_mm=-0.125, size_mm=100)],
        grid,
        IsotropicPhase((0, 0, 0)),
        lights=[DirectionalLight(direction=(0, 1, 0))],
        max_bounces=1,
        camera=looking_down(width=0.2, middle=(0.8, 0.0, 0.8)),
        samples_per_pixel=256,
        tracking=tracking,
    )
    transmittance = math.exp(-0.275 * projected_extinction(density, 0.0))
    assert abs(z_score(result, transmittance**2 / math.pi)) < Z_LIMIT
    assert picture_mean(result)[1] < 0.01 * transmittance**2 / math.pi


def test_an_opaque_ball_hides_the_light(tmp_path):
    ball = MeshSurface(
        file=write_ball(tmp_path), material=WHITE, placements=[Placement(position_mm=(10, 5, 10))]
    )
    ground = GroundSurface(material=WHITE, size_mm=100)
    camera = PerspectiveCamera(position_mm=(10, 3, 13), target_mm=(10, 0, 10), fov_deg=4)
    result = render(
        [ball, ground], lights=[DirectionalLight(direction=(0, 1, 0))], camera=camera, max_bounces=1
    )
    assert result.layers["A"].min() == 1
    assert result.radiance.max() == 0


def test_how_directions_are_chosen_does_not_change_the_mean(tmp_path):
    ball = MeshSurface(
        file=write_ball(tmp_path),
        material=DiffuseMaterial(color=(0.8, 0.6, 0.4)),
        placements=[Placement(position_mm=(1, 0.2, 0.2), scale=0.4)],
    )
    grid = volume(random_grid((2, 2, 2), seed=5, fill=0.5))
    scene = [ball, GroundSurface(size_mm=20, material=DiffuseMaterial(color=(0.7, 0.7, 0.2)))]
    settings = {
        "lights": [StudioLight()],
        "camera": PerspectiveCamera(view_direction=(0.5, 0.6, 1.0)),
        "resolution": (24, 24),
        "samples_per_pixel": 200,
    }
    pictures = [
        render(scene, grid, TABLE["reference"], sampling=s, seed=i, **settings)
        for i, s in enumerate(("both", "lights", "phase"))
    ]
    delta = render(scene, grid, TABLE["reference"], tracking="delta", seed=9, **settings)
    for other in (*pictures[1:], delta):
        assert abs(welch_z(pictures[0], other, channel=1)) < Z_LIMIT
    assert picture_mean(pictures[0])[1] < 0.01 * picture_mean(pictures[0])[0]


def test_no_scheduling_changes_a_bit(tmp_path):
    ball = MeshSurface(
        file=write_ball(tmp_path), placements=[Placement(position_mm=(1, 0.2, 0.2), scale=0.4)]
    )
    config = RenderConfig(
        resolution=(16, 12),
        samples_per_pixel=3,
        surfaces=[ball, GroundSurface(size_mm=20)],
        camera=PerspectiveCamera(view_direction=(0.5, 0.6, 1.0)),
    )
    grid = volume(random_grid((2, 2, 2), seed=5, fill=0.5))
    pictures = [
        run(config, grid, {"a": TABLE["reference"]}, options=KernelOptions(**options))
        for options in (
            {},
            {"rounds_per_dispatch": 1, "steps_per_round": 1, "seeks_per_round": 1},
            {"lane_count": 64, "seeks_per_round": 7},
        )
    ]
    for other in pictures[1:]:
        for name, layer in pictures[0].layers.items():
            np.testing.assert_array_equal(layer, other.layers[name], err_msg=name)


def test_a_texture_shows_its_texels_where_they_are(tmp_path):
    """Means over quarters of a ground covered by one copy; sRGB is decoded before it is averaged."""
    picture = np.array([[[255, 0, 0], [0, 128, 0]], [[0, 0, 55], [200, 200, 200]]], np.uint8)
    Image.fromarray(np.kron(picture, np.ones((16, 16, 1), np.uint8))).save(tmp_path / "t.png")
    ground = GroundSurface(
        material=DiffuseMaterial(color=(1, 1, 0.5), texture=tmp_path / "t.png"), size_mm=2, texture_size_mm=2
    )
    camera = looking_down(width=2.0, middle=(0.2, 0.0, 0.2))
    result = render([ground], resolution=(32, 32), samples_per_pixel=1, camera=camera)
    seen = np.stack([result.layers[f"albedo.{c}"] for c in "RGB"], axis=-1)
    s = picture / 255
    linear = np.where(s <= 0.04045, s / 12.92, ((s + 0.055) / 1.055) ** 2.4) * [1, 1, 0.5]
    blocks = seen.reshape(2, 16, 2, 16, 3)[:, 2:14, :, 2:14]
    hit = blocks.sum(-1) > 0
    assert hit.mean() > 0.7  # the volume stands in the middle
    expected = np.broadcast_to(linear[:, None, :, None], blocks.shape)
    ground_hit = np.abs(blocks - expected).max(-1) < 2e-3
    assert ground_hit.mean() > 0.85


def test_texture_lookup_is_bilinear_and_repeats():
    rng = np.random.default_rng(1)
    texels = rng.integers(0, 256, (5, 8, 3)).astype(np.uint32)
    words = (texels[..., 0] | texels[..., 1] << 8 | texels[..., 2] << 16).view(np.float32).reshape(-1, 4)
    lookup = probe(
        "surface/texture.glsl",
        "vec3 texture_color(uint first, ivec2 size, vec2 uv)",
        prelude="layout(std430, binding = 2) readonly buffer L { vec4 lights[]; };\n"
        "uniform uint surface_texels;",
        blocks={2: words},
        uniforms={"surface_texels": 0},
    )
    uv = rng.random((500, 2)) * 4 - 2
    seen = lookup(0, (8, 5), uv)
    s = texels / 255
    linear = np.where(s <= 0.04045, s / 12.92, ((s + 0.055) / 1.055) ** 2.4)
    place = (uv - np.floor(uv)) * [8, 5] - 0.5
    low = np.floor(place).astype(int)
    part = (place - low)[:, :, None]
    (x0, y0), (x1, y1) = (low % [8, 5]).T, ((low + 1) % [8, 5]).T
    rows = [linear[y, x0] * (1 - part[:, 0]) + linear[y, x1] * part[:, 0] for y in (y0, y1)]
    np.testing.assert_allclose(seen, rows[0] * (1 - part[:, 1]) + rows[1] * part[:, 1], atol=2e-5)


def test_diffuse_samples_follow_their_density():
    sample = probe("surface/diffuse.glsl", "vec3 diffuse_sample(vec3 wo, vec2 u)")
    u = np.random.default_rng(2).random((100_000, 2), dtype=np.float32)
    wi = sample((0.0, 0.6, 0.8), u).astype(float)
    counts = np.histogram2d(
        wi[:, 2] ** 2, np.arctan2(wi[:, 1], wi[:, 0]), [10, 12], [[0, 1], [-np.pi, np.pi]]
    )[0]
    assert stats.chisquare(counts.ravel()).pvalue > 1e-4  # cosine-weighted: uniform in cos^2 and azimuth
    pdf = probe("surface/diffuse.glsl", "float diffuse_pdf(vec3 wo, vec3 wi)")
    value = probe("surface/diffuse.glsl", "float diffuse_eval(vec3 wo, vec3 wi)")
    np.testing.assert_allclose(pdf((0, 0, 1.0), wi), wi[:, 2] / math.pi, rtol=1e-5)
    np.testing.assert_allclose(value((0, 0, 1.0), wi) * wi[:, 2], pdf((0, 0, 1.0), wi), rtol=1e-5)
    assert value((0, 0, 1.0), (0, 0, -1.0)) == pdf((0, 0, 1.0), (0, 0, -1.0)) == 0


def test_mesh_files_and_pictures_are_read_right(tmp_path):
    mesh = load_mesh(write_ball(tmp_path, subdivisions=1, radius=2))
    assert len(mesh) == 80
    np.testing.assert_allclose(np.linalg.norm(mesh.corners, axis=-1), 2, atol=1e-6)
    assert ((mesh.normals * mesh.corners).sum(-1) > 1.9).all()
    Image.fromarray(np.array([[[1, 2, 3]], [[4, 5, 6]]], np.uint8)).save(tmp_path / "t.png")
    np.testing.assert_array_equal(read_texture(tmp_path / "t.png"), [[0x060504], [0x030201]])


def test_a_ball_has_the_volume_and_the_normals_of_a_sphere():
    ball = ball_triangles(BallSurface(position_mm=(1, 2, 3), radius_mm=2.0), 7)
    local = ball.corners - [1, 2, 3]
    inside = np.einsum("ni,ni->n", local[:, 0], np.cross(local[:, 1], local[:, 2])).sum() / 6
    assert inside == pytest.approx(4 / 3 * math.pi * 8, rel=1e-9)
    np.testing.assert_allclose(local / np.linalg.norm(local, axis=-1, keepdims=True), ball.normals, atol=1e-9)
    assert np.ptp(ball.uvs[..., 0], axis=1).max() < 0.5
    assert set(ball.material) == {7}


def test_a_sweep_is_a_ball_per_value_and_row():
    rows = [
        SweepRow(parameter="roughness"),
        SweepRow(parameter="sheen", material=PrincipledMaterial(metallic=1)),
    ]
    sweep = SweepSurface(rows=rows, values=(0.0, 0.5, 1.0), position_mm=(10, 0, 0), step_mm=(0, -3, 0))
    balls = sweep_balls(sweep)
    assert [ball.material.roughness for ball in balls] == [0, 0.5, 1, 0.5, 0.5, 0.5]
    assert [ball.material.sheen for ball in balls] == [0, 0, 0, 0, 0.5, 1]
    assert balls[-1].position_mm == (12.4, -6, 0)
    assert balls[-1].material.metallic == 1
    picture = render(
        [sweep], camera=OrthographicCamera(position_mm=(11, -3, 9), target_mm=(11, -3, 0), frame_width_mm=9)
    )
    assert np.isfinite(picture.layers["Z"]).mean() > 0.15
    with pytest.raises(ValidationError, match=r"64 x 64 balls; at most 512"):
        SweepSurface(rows=[rows[0]] * 64, values=[0.5] * 64)
