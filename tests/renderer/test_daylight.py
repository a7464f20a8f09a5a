"""Sky and sun of Preetham et al. 1999: what their formulas and the day itself say."""

from __future__ import annotations

import math

import numpy as np
import pytest

from weft.renderer.config import DaylightLight
from weft.renderer.daylight import sky_color, sun_direction, sun_light, zenith_color
from weft.renderer.environment import LUMINANCE, build_environment, texel_directions, texel_solid_angles
from weft.renderer.lights import build_light_table

UP = np.array([0.0, 1.0, 0.0])


@pytest.mark.parametrize("turbidity", [2.5, 6.0])
@pytest.mark.parametrize("elevation", [15.0, 60.0])
def test_straight_up_it_has_the_luminance_and_chromaticity_of_the_zenith(turbidity, elevation):
    light = DaylightLight(sun_elevation_deg=elevation, turbidity=turbidity)
    rgb = sky_color(UP, light) / 0.1
    luminance, x, y = zenith_color(math.radians(90 - elevation), turbidity)
    xyz = (
        np.linalg.inv(
            [
                [3.2404542, -1.5371385, -0.4985314],
                [-0.969266, 1.8760108, 0.041556],
                [0.0556434, -0.2040259, 1.0572252],
            ]
        )
        @ rgb
    )
    assert xyz[1] == pytest.approx(luminance, rel=1e-6)
    assert xyz[0] / xyz.sum() == pytest.approx(x, rel=1e-6)
    assert xyz[1] / xyz.sum() == pytest.approx(y, rel=1e-6)
    assert 1 < luminance < 30  # kcd/m2, as measured skies have


def test_it_is_brightest_around_the_sun_and_the_same_on_both_sides_of_it():
    light = DaylightLight(sun_elevation_deg=35, sun_azimuth_deg=0)
    directions = texel_directions(64)
    above = directions[..., 1] > 0.05
    brightness = np.where(above, sky_color(directions, light) @ LUMINANCE, 0)
    brightest = directions[np.unravel_index(brightness.argmax(), brightness.shape)]
    assert brightest @ sun_direction(light) > math.cos(math.radians(6))
    mirrored = directions * [-1, 1, 1]  # the sun stands over +z
    np.testing.assert_allclose(sky_color(mirrored, light), sky_color(directions, light), atol=1e-12)


def test_a_clear_sky_is_blue_and_a_low_sun_red():
    high, low = DaylightLight(sun_elevation_deg=70), DaylightLight(sun_elevation_deg=4)
    red, _, blue = sky_color(UP, high)
    assert blue > 1.5 * red
    ratios = [light.irradiance[0] / light.irradiance[2] for light in map(sun_light, (high, low))]
    assert 1 < ratios[0] < 1.4
    assert ratios[1] > 3


def test_light_on_the_ground_at_noon_is_about_that_of_a_summer_day():
    """80,000 to 120,000 lux, a tenth to a third of it from the sky."""
    light = DaylightLight(sun_elevation_deg=65, intensity=1.0)
    picture = build_environment([light], np.eye(3)).astype(float)
    directions = texel_directions(len(picture))
    weight = np.maximum(directions[..., 1], 0) * texel_solid_angles(len(picture))[:, None]
    sky = (picture * weight[..., None]).sum(axis=(0, 1)) @ LUMINANCE
    sun = np.array(sun_light(light).irradiance) @ LUMINANCE * math.sin(math.radians(65))
    assert 8 < sky + sun < 12
    assert 0.1 < sky / (sky + sun) < 0.33


def test_the_sun_is_a_directional_light_unless_left_out():
    tables = [build_light_table([DaylightLight(sun=sun)], np.eye(3)) for sun in (True, False)]
    assert len(tables[0].entries) == len(tables[1].entries) + 1
    np.testing.assert_allclose(tables[0].directions[0, :3], sun_direction(DaylightLight()), atol=1e-6)
