"""Lights turned around the cloth: all kinds by the same angle in the same direction."""

from __future__ import annotations

import math

import numpy as np
import pytest

from weft.renderer.camera import rotation
from weft.renderer.config import (
    ConstantLight,
    DaylightLight,
    DirectionalLight,
    EnvironmentLight,
    QuadLight,
    SkyLight,
    SoftboxLight,
    SpotLight,
    StudioLight,
)
from weft.renderer.daylight import sun_direction
from weft.renderer.environment import build_environment, texel_directions
from weft.renderer.image import write_exr
from weft.renderer.light_config import MeshLight
from weft.renderer.surface_config import Placement
from weft.renderer.turned_lights import turned_lights

MIDDLE = np.array([1.0, 2.0, 3.0])


def brightest(lights, axes):
    """Direction to the brightest texel."""
    picture = build_environment(lights, axes)
    return texel_directions(len(picture)).reshape(-1, 3)[picture.sum(axis=-1).argmax()]


def test_an_environment_turns_as_a_directional_light_does(tmp_path):
    picture = np.zeros((16, 32), np.float32)
    picture[5, 3] = 1.0
    write_exr(tmp_path / "spot.exr", dict.fromkeys("RGB", picture), {})
    environment = EnvironmentLight(file=tmp_path / "spot.exr")
    sun = DirectionalLight(direction=tuple(brightest([environment], np.eye(3))))
    turned, turned_sun = turned_lights([environment, sun], 90.0, MIDDLE)
    np.testing.assert_allclose(brightest([turned], np.eye(3)), turned_sun.direction, atol=1e-6)


def test_a_studio_turns_with_the_cameras_axes():
    turn = rotation(1, math.pi / 2)
    before, after = brightest([StudioLight()], np.eye(3)), brightest([StudioLight()], np.eye(3) @ turn.T)
    np.testing.assert_allclose(after, turn @ before, atol=0.03)


@pytest.mark.parametrize(
    "light",
    [
        SpotLight(position_mm=(1.0, 2.0, 13.0), intensity=(1.0, 1.0, 1.0)),
        QuadLight(position_mm=(1.0, 2.0, 13.0), radiance=(1.0, 1.0, 1.0), width_mm=1.0, height_mm=1.0),
    ],
)
def test_lights_go_around_the_middle_counterclockwise_seen_from_above(light):
    (turned,) = turned_lights([light], 90.0, MIDDLE)
    np.testing.assert_allclose(turned.position_mm, (11.0, 2.0, 3.0), atol=1e-12)


def test_daylight_turns_as_its_sun_does():
    light = DaylightLight(sun_azimuth_deg=25.0)
    (turned,) = turned_lights([light], 70.0, MIDDLE)
    expected = rotation(1, math.radians(70.0)) @ sun_direction(light)
    np.testing.assert_allclose(sun_direction(turned), expected, atol=1e-12)


def test_a_bright_mesh_turns_as_its_points_do(tmp_path):
    (tmp_path / "lamp.obj").write_text("")
    placement = Placement(rotation_deg=(20.0, 50.0, -30.0), position_mm=(4.0, 5.0, 6.0), scale=2.0)
    mesh = MeshLight(file=tmp_path / "lamp.obj", radiance=(1.0, 1.0, 1.0), placement=placement)
    (turned,) = turned_lights([mesh], 35.0, MIDDLE)
    points = np.random.default_rng(1).normal(size=(5, 3))
    around = rotation(1, math.radians(35.0))
    expected = MIDDLE + (placed(points, placement) - MIDDLE) @ around.T
    np.testing.assert_allclose(placed(points, turned.placement), expected, atol=1e-12)


def placed(points, placement):
    for axis, angle in enumerate(np.radians(placement.rotation_deg)):
        points = points @ rotation(axis, angle).T
    return placement.scale * points + np.array(placement.position_mm)


def test_what_has_no_side_stays():
    lights = [ConstantLight(), SkyLight(), StudioLight(), SoftboxLight()]
    assert list(turned_lights(lights, 50.0, MIDDLE)) == lights
