"""The shader's camera rays are those of the frame computed in Python, and samples are spread evenly."""

from __future__ import annotations

import numpy as np
import pytest

from weft.renderer.camera import place_camera
from weft.renderer.config import OrthographicCamera, PerspectiveCamera

from .probe import probe

pytestmark = pytest.mark.gl

BOX = np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 1.0]])
UNIFORMS = """
uniform int camera_perspective;
uniform vec3 camera_position;
uniform vec3 camera_forward;
uniform vec3 camera_right;
uniform vec3 camera_up;
"""


@pytest.mark.parametrize("camera", [PerspectiveCamera(view_direction=(1, 2, 3)), OrthographicCamera()])
def test_rays_pass_through_their_place_in_the_picture(camera):
    frame = place_camera(camera, BOX, (40, 30))
    uniforms = {
        f"camera_{name}": tuple(getattr(frame, name)) for name in ("position", "forward", "right", "up")
    }
    ray = probe(
        "camera/camera.glsl",
        "void camera_ray(vec2 place, out vec3 origin, out vec3 direction)",
        prelude=UNIFORMS,
        uniforms=uniforms | {"camera_perspective": int(frame.perspective)},
    )
    place = np.random.default_rng(1).uniform(-1, 1, (100, 2))
    origin, direction = ray(place)
    point = origin + 5 * direction - frame.position
    depth = (point @ frame.forward)[:, None] if frame.perspective else 1.0
    back = np.stack([point @ v / (v @ v) for v in (frame.right, frame.up)], axis=1) / depth
    np.testing.assert_allclose(back, place, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(direction, axis=1), 1, atol=1e-6)


@pytest.mark.parametrize("count", [16, 64, 1000])
def test_samples_of_a_pixel_are_spread_evenly(count):
    """No 4 x 4 stratum is far from its share; with 1000 independent samples some would be 27 off."""
    jitter = probe(
        "camera/camera.glsl", "vec2 pixel_jitter(uint sample_index, uvec2 shift)", prelude=UNIFORMS
    )
    shifts = np.random.default_rng(2).integers(0, 2**32, (50, 1, 2), dtype=np.uint32)
    places = jitter(np.arange(count), shifts)
    assert places.min() >= 0
    assert places.max() < 1
    for points in places:
        seen = np.histogram2d(*points.T, bins=4, range=[[0, 1], [0, 1]])[0]
        assert np.abs(seen - count / 16).max() <= 6
    assert abs(places.mean() - 0.5) < 0.01
