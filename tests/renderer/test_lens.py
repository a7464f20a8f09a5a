"""The thin lens: its aperture is filled evenly, focus is sharp, and blur has the size of theory."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydantic import ValidationError
from scipy import stats

from weft.renderer.camera import place_camera
from weft.renderer.config import ConstantLight, OrthographicCamera, PerspectiveCamera, RenderConfig
from weft.renderer.render import run
from weft.renderer.scene import IsotropicPhase

from .probe import probe
from .volumes import uniform_grid, volume

ERROR_PROBABILITY = 1e-4
FORWARD, RIGHT, UP = (0.0, 0.6, -0.8), (0.5, 0.0, 0.0), (0.0, 0.32, 0.24)
UNIFORMS = (
    "uniform vec3 camera_forward;\nuniform vec3 camera_right;\nuniform vec3 camera_up;\nuniform vec4 lens;\n"
)


def numbers(count, seed=1):
    return np.random.default_rng(seed).random((count, 2), dtype=np.float32)


def lens_rays(lens, origin, direction, u):
    call = probe(
        "camera/lens.glsl",
        "void lens_ray(vec2 u, inout vec3 origin, inout vec3 direction)",
        prelude=UNIFORMS,
        uniforms={"camera_forward": FORWARD, "camera_right": RIGHT, "camera_up": UP, "lens": lens},
    )
    return call(u, origin, direction)


def chi_square_p(counts, expected):
    return stats.chisquare(counts, expected * counts.sum() / expected.sum()).pvalue


@pytest.mark.gl
def test_a_round_aperture_is_filled_evenly():
    """Rings and sectors of equal area get equal numbers."""
    disk = probe("camera/lens.glsl", "vec2 disk_place(vec2 u)", prelude=UNIFORMS)
    x, y = disk(numbers(200_000)).T.astype(float)
    rings, sectors = 8, 16
    counts = np.histogram2d(x**2 + y**2, np.arctan2(y, x), [rings, sectors], [[0, 1], [-np.pi, np.pi]])[0]
    assert counts.sum() == pytest.approx(200_000, abs=5)  # all but rounding lie in the disk
    assert chi_square_p(counts.ravel(), np.ones(rings * sectors)) > ERROR_PROBABILITY


@pytest.mark.gl
@pytest.mark.parametrize("corners", [3, 5, 6])
def test_a_polygonal_aperture_is_filled_evenly(corners):
    """Against the area of the turned polygon in each cell of a raster."""
    rotation = 0.3
    place = probe(
        "camera/lens.glsl", "vec2 polygon_place(float corners, float rotation, vec2 u)", prelude=UNIFORMS
    )
    points = place(float(corners), rotation, numbers(200_000, seed=2)).astype(float)
    cells, parts = 8, 200
    ticks = (np.arange(cells * parts) + 0.5) / (cells * parts) * 2 - 1
    fine = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), -1)
    angle = rotation + (np.arange(corners) + 0.5) * 2 * np.pi / corners
    apothem = math.cos(math.pi / corners)
    normals = np.stack([np.cos(angle), np.sin(angle)])
    inside = (fine @ normals <= apothem).all(-1)
    assert (points @ normals <= apothem + 1e-5).all()
    area = inside.reshape(cells, parts, cells, parts).sum(axis=(1, 3)).astype(float)
    counts = np.histogram2d(*points.T, bins=cells, range=[[-1, 1]] * 2)[0]
    seen = area > parts**2 / 50
    assert counts[area == 0].sum() == 0
    assert chi_square_p(counts[seen], area[seen]) > ERROR_PROBABILITY


@pytest.mark.gl
@pytest.mark.parametrize("corners", [0.0, 5.0])
def test_rays_meet_in_the_plane_of_focus_and_spread_as_theory_says(corners):
    """At distance d along the view the rays of a point fill the aperture scaled by |1 - d/f|."""
    radius, focus = 0.7, 12.0
    origin, direction = np.array([1.0, 2.0, 3.0]), np.array(FORWARD) + 0.4 * np.array(RIGHT)
    direction /= np.linalg.norm(direction)
    starts, directions = lens_rays((radius, focus, corners, 0.1), origin, direction, numbers(4000))
    at_focus = starts + directions * (focus / (directions @ FORWARD))[:, None]
    pinhole = origin + direction * focus / (direction @ FORWARD)
    np.testing.assert_allclose(at_focus, np.broadcast_to(pinhole, at_focus.shape), atol=2e-5)
    for depth in (0.0, 4.0, 30.0):
        points = starts + directions * (depth / (directions @ FORWARD))[:, None]
        middle = origin + direction * depth / (direction @ FORWARD)
        spread = np.linalg.norm(points - middle, axis=1).max()
        assert spread == pytest.approx(radius * abs(1 - depth / focus), rel=0.01)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-6)


def test_focus_is_on_the_target_unless_told():
    box = np.array([[0.0, 0.0, 0.0], [4.0, 4.0, 1.0]])
    unset = PerspectiveCamera(aperture_radius_mm=1, position_mm=(0, 0, 9), target_mm=(3, 4, 9))
    assert place_camera(unset, box, (4, 4)).focus_distance == pytest.approx(5)
    told = PerspectiveCamera(aperture_radius_mm=1, focus_distance_mm=2.5)
    assert place_camera(told, box, (4, 4)).focus_distance == 2.5


def test_settings_without_effect_are_refused():
    with pytest.raises(ValidationError, match="focus_distance_mm without aperture_radius_mm"):
        PerspectiveCamera(focus_distance_mm=3)
    with pytest.raises(ValidationError, match="a polygon has 3 or more"):
        PerspectiveCamera(aperture_radius_mm=1, aperture_blades=2)


@pytest.mark.gl
def test_a_blurred_edge_has_the_width_of_theory():
    """Opacity across the straight edge of an opaque sheet: the part of the blur disk on its one side."""
    grid = uniform_grid((2, 2, 1), 500.0, (1, 0, 0))  # fills [0, 0.8] x [0, 0.8] x [0, 0.4] mm
    depth, focus, radius = 1000.0, 500.0, 0.1  # so far away that the sheet's thickness hides nothing
    camera = PerspectiveCamera(
        position_mm=(0.8, 0.4, 0.4 + depth),
        target_mm=(0.8, 0.4, 0.4),
        fov_deg=2 * math.degrees(math.atan(0.2 / depth)),
        aperture_radius_mm=radius,
        focus_distance_mm=focus,
    )
    config = RenderConfig(
        resolution=(16, 16), samples_per_pixel=1024, camera=camera, lights=[ConstantLight()], max_bounces=1
    )
    seen = run(config, volume(grid), {"a": IsotropicPhase((0, 0, 0))}).layers["A"].astype(float)
    blur = radius * abs(1 - depth / focus)
    fine = (np.arange(1600) + 0.5) / 1600 * 0.4 - 0.2
    c = np.clip(-fine / blur, -1, 1)
    share = 0.5 + (c * np.sqrt(1 - c**2) + np.arcsin(c)) / np.pi  # of a disk left of the edge
    expected = share.reshape(16, 100).mean(axis=1)
    error = np.sqrt(np.maximum(expected * (1 - expected), 1e-4) / 1024 / 16)
    z = (seen.mean(axis=0) - expected) / error
    assert np.abs(z).max() < 4.6  # 16 columns, 1e-4 in all


def test_a_parallel_camera_has_no_lens():
    frame = place_camera(OrthographicCamera(), np.array([[0.0, 0, 0], [1, 1, 1]]), (4, 4))
    assert frame.aperture_radius == 0
