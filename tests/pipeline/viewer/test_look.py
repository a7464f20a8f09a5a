"""Looks are plain values: a job's camera comes back from them, and they from the TOML they give."""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace

import numpy as np
import pytest

from weft.pipeline.viewer.browser import eight_bits, linear_color
from weft.pipeline.viewer.desk import Desk
from weft.pipeline.viewer.look import Eye, Look, as_toml, eye_of, frame_of
from weft.renderer.camera import place_camera
from weft.renderer.config import OrthographicCamera, PerspectiveCamera

BOUNDS = np.array([[-3.0, -2.0, -0.5], [5.0, 4.0, 1.0]])
MIDDLE = BOUNDS.mean(axis=0)
SIZE = (300, 200)
OBLIQUE = PerspectiveCamera(view_direction=(1.0, 0.5, 2.0), up=(0.1, 1.0, 0.0), fov_deg=25.0)
LOOK = Look(Eye((0.0, 1.0, 9.0), (1.0, 1.0, 0.25), (0.0, 1.0, 0.0), 0.4), SIZE)


def test_the_eye_of_a_camera_sees_what_the_camera_sees():
    lens = place_camera(OBLIQUE, BOUNDS, SIZE)
    frame = frame_of(Look(eye_of(lens, MIDDLE), SIZE), lens)
    for name in ("position", "forward", "right", "up"):
        np.testing.assert_allclose(getattr(frame, name), getattr(lens, name), atol=1e-12)


def test_parallel_rays_become_a_long_lens_with_the_same_frame_at_the_target():
    flat = place_camera(OrthographicCamera(view_direction=(0.0, 0.3, 1.0)), BOUNDS, SIZE)
    frame = frame_of(Look(eye_of(flat, MIDDLE), SIZE), flat)
    away = np.linalg.norm(frame.position - MIDDLE)
    np.testing.assert_allclose(frame.right * away, flat.right, atol=1e-9)
    np.testing.assert_allclose(frame.up * away, flat.up, atol=1e-9)


def test_a_wider_canvas_shows_more_at_the_sides_and_the_same_height():
    lens = place_camera(OBLIQUE, BOUNDS, SIZE)
    wide = frame_of(replace(LOOK, size=(600, 200), longest_side=600), lens)
    narrow = frame_of(replace(LOOK, size=(300, 200), longest_side=600), lens)
    np.testing.assert_allclose(wide.right, 2 * narrow.right)
    np.testing.assert_allclose(wide.up, narrow.up)


def test_the_downloaded_camera_is_the_one_on_the_screen():
    table = tomllib.loads(as_toml(LOOK, job_aspect=1.5, every_medium=True))
    camera = place_camera(PerspectiveCamera(**table["render"]["camera"]), BOUNDS, SIZE)
    frame = frame_of(LOOK, camera)
    for name in ("position", "forward", "right", "up"):
        np.testing.assert_allclose(getattr(camera, name), getattr(frame, name), atol=1e-5)


def test_the_downloaded_fibers_are_those_that_were_changed():
    look = LOOK.edited("warp", longitudinal_width_r=math.radians(9)).edited("warp", color_tt=(0.5, 0.25, 1.0))
    values = {"longitudinal_width_r_deg": 9.0, "color_tt": [0.5, 0.25, 1.0]}
    assert tomllib.loads(as_toml(look, job_aspect=1.0, every_medium=True))["scattering"] == values
    by_type = tomllib.loads(as_toml(look, job_aspect=1.0, every_medium=False))["scattering"]["by_type"]
    assert by_type == {"warp": values}


@pytest.mark.parametrize("value", [0, 1, 10, 11, 128, 254, 255])
def test_colors_of_the_picker_come_back(value):
    assert eight_bits(linear_color((value, 255 - value, value))) == (value, 255 - value, value)


def test_the_same_look_is_no_change():
    desk = Desk(LOOK)
    version = desk.take()[1]
    desk.change(lambda look: replace(look, exposure=0.0))
    assert not desk.wait_past(version, 0)
    desk.change(lambda look: replace(look, exposure=1.0))
    assert desk.wait_past(version, 0)
    assert desk.look.drawing == LOOK.drawing
