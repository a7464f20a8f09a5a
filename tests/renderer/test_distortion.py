"""Lens distortion: lamps appear where the formula of Brown says; lenses without a picture are refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

from weft.files.errors import InputError
from weft.renderer.camera import place_camera
from weft.renderer.config import DiskLight, PerspectiveCamera, RenderConfig
from weft.renderer.distortion import distorted, reaches, undistorted
from weft.renderer.render import run
from weft.renderer.scene import IsotropicPhase

from .probe import probe
from .volumes import uniform_grid, volume

LENSES = [(-0.25, 0.0), (0.4, 0.0), (-0.3, 0.12), (0.2, -0.1)]
HALF = (0.5, 0.4)
"""Half width and height of the picture, in focal lengths."""
SIZE = (200, 160)
DISTANCE_MM = 100.0
THIN_AIR = volume(uniform_grid((1, 1, 1), 1e-9, (1.0, 0.0, 0.0)))


def places(count=500, seed=3):
    return np.random.default_rng(seed).uniform(-1, 1, (count, 2)) * HALF


@pytest.mark.parametrize(("k1", "k2"), LENSES)
def test_undistorted_is_the_inverse_of_the_formula(k1, k2):
    seen = places()
    np.testing.assert_allclose(distorted(undistorted(seen, k1, k2), k1, k2), seen, atol=1e-6)


@pytest.mark.gl
@pytest.mark.parametrize(("k1", "k2"), LENSES)
def test_the_shader_equals_its_twin(k1, k2):
    call = probe(
        "camera/distortion.glsl",
        "vec2 undistorted(vec2 place)",
        prelude="uniform vec4 distortion;\n",
        uniforms={"distortion": (k1, k2, *HALF)},
    )
    seen = places()
    np.testing.assert_allclose(call(seen / HALF) * HALF, undistorted(seen, k1, k2), atol=2e-6)


@pytest.mark.gl
@pytest.mark.parametrize(("k1", "k2"), LENSES)
def test_a_grid_of_lamps_is_seen_where_the_formula_says(k1, k2):
    """Nine small disks in a plane across the view; the middle of each one's light, in pixels."""
    camera = PerspectiveCamera(
        position_mm=(0, 0, DISTANCE_MM), target_mm=(0, 0, 0), fov_deg=2 * math.degrees(math.atan(HALF[0])),
        distortion_k1=k1, distortion_k2=k2,
    )  # fmt: skip
    lamps = [
        DiskLight(position_mm=(x, y, 0.0), target_mm=(x, y, 1.0), radius_mm=0.8, radiance=(1.0, 1.0, 1.0))
        for x in (-36.0, 0.0, 36.0)
        for y in (-29.0, 0.0, 29.0)
    ]
    config = RenderConfig(resolution=SIZE, samples_per_pixel=32, camera=camera, lights=lamps)
    green = run(config, THIN_AIR, {"a": IsotropicPhase()}).radiance[..., 1]
    rows, columns = np.indices(green.shape) + 0.5
    for lamp in lamps:
        seen = distorted(np.array(lamp.position_mm[:2]) / DISTANCE_MM, k1, k2) / HALF
        expected = (seen * (1, -1) + 1) / 2 * SIZE
        near = np.hypot(columns - expected[0], rows - expected[1]) < 6
        light = green * near
        found = np.array([(light * columns).sum(), (light * rows).sum()]) / light.sum()
        np.testing.assert_allclose(found, expected, atol=0.1)


def test_a_lens_that_folds_its_picture_is_refused():
    assert reaches(-0.3, 0.12, 0.64)
    assert not reaches(-1.5, 0.0, 0.64)
    camera = PerspectiveCamera(fov_deg=90, distortion_k1=-0.5)
    with pytest.raises(InputError, match="the corners show nothing"):
        place_camera(camera, np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]), SIZE)
