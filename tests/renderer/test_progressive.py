"""The interactive picture: what changes on the device gives the picture of a render from scratch."""

from __future__ import annotations

import numpy as np
import pytest

from weft.renderer.camera import place_camera
from weft.renderer.config import ConstantLight, DirectionalLight, PerspectiveCamera, QuadLight, RenderConfig
from weft.renderer.progressive import ProgressiveRender
from weft.renderer.render import run
from weft.renderer.scene import IsotropicPhase

from .volumes import random_grid, volume

pytestmark = pytest.mark.gl
GRID = volume(random_grid((2, 2, 1), seed=5, peak=0.5, fill=0.6))
BOUNDS = np.asarray(GRID.bounds_mm)
CONFIG = RenderConfig(resolution=(24, 16), samples_per_pixel=4, lights=[ConstantLight()])
GRAY = {"a": IsotropicPhase((0.6, 0.6, 0.6))}
SIDE = PerspectiveCamera(view_direction=(1.0, 0.4, 0.3))


@pytest.fixture
def progressive():
    render = ProgressiveRender(CONFIG, GRID, GRAY)
    yield render
    render.release()


def last(render, samples=4):
    *_, picture = render.refine(samples, lambda: False)
    return picture


def from_scratch(lobes=GRAY, **settings):
    return run(CONFIG.model_copy(update=settings), GRID, lobes).radiance


def test_a_finished_picture_is_the_rendered_one(progressive):
    picture = last(progressive)
    assert (picture.scale, picture.samples) == (1, 4)
    np.testing.assert_allclose(picture.radiance, from_scratch(), rtol=1e-5)


def test_another_camera_and_size(progressive):
    last(progressive)
    progressive.look(place_camera(SIDE, BOUNDS, (20, 30)), (20, 30))
    np.testing.assert_allclose(
        last(progressive).radiance, from_scratch(camera=SIDE, resolution=(20, 30)), rtol=1e-5
    )


@pytest.mark.parametrize(
    "light",
    [
        DirectionalLight(direction=(1.0, 2.0, 3.0)),
        QuadLight(position_mm=(0.0, 9.0, 3.0), radiance=(5.0, 4.0, 3.0), width_mm=3.0, height_mm=2.0),
    ],
)
def test_another_light_also_where_it_needs_other_code(progressive, light):
    last(progressive)
    progressive.light([light], progressive.scene.camera.axes)
    np.testing.assert_allclose(last(progressive).radiance, from_scratch(lights=(light,)), rtol=1e-5)


def test_another_color(progressive):
    last(progressive)
    red = {"a": IsotropicPhase((0.9, 0.3, 0.2))}
    progressive.scatter(red)
    np.testing.assert_allclose(last(progressive).radiance, from_scratch(red), rtol=1e-5)


def test_coarse_pictures_come_first_where_the_device_is_slow(progressive):
    progressive.paths_per_second = 24 * 16 / 0.15 / 16
    scales = [picture.scale for picture in progressive.refine(3, lambda: False)]
    assert scales[0] >= 2
    assert scales == sorted(scales, reverse=True)
    assert scales[-1] == 1


def test_a_change_stops_the_samples_under_way(progressive):
    """All but the first: one sees something also while one drags the camera."""
    assert [picture.samples for picture in progressive.refine(4, lambda: True)] == [1]
    np.testing.assert_allclose(last(progressive).radiance, from_scratch(), rtol=1e-5)
