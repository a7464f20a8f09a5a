"""Masks lie where they say, seen by unit vectors."""

import numpy as np
import pytest

from weft.fitting.config import MaskRegion
from weft.fitting.masks import beyond, in_region, near_forward, near_light, near_specular
from weft.fitting.measurements import Measurements
from weft.fitting.surface_directions import vectors


def sphere(quantity, count=4000):
    rng = np.random.default_rng(12)
    low = 0.0 if quantity == "brdf" else -np.pi / 2
    return Measurements(
        theta_i=np.repeat(np.deg2rad([0.0, 30.0, 60.0]), count),
        phi_i=np.repeat([0.0, 1.0, -2.0], count),
        theta_o=rng.uniform(low, np.pi / 2, 3 * count),
        phi_o=rng.uniform(-np.pi, np.pi, 3 * count),
        values=np.ones((3 * count, 1)),
        quantity=quantity,
    )


def fiber_vectors(theta, phi):
    return np.stack([np.sin(theta), np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi)], axis=1)


def apart(one, two):
    return np.arccos(np.clip((one * two).sum(axis=1), -1.0, 1.0))


def directions(m):
    to = vectors if m.quantity == "brdf" else fiber_vectors
    return to(m.theta_i, m.phi_i), to(m.theta_o, m.phi_o)


def assert_is(mask, expected):
    assert np.array_equal(mask, expected)
    assert 0 < mask.sum() < len(mask)


def test_the_forward_direction_of_a_fiber_is_opposite_to_the_light():
    m = sphere("bcsdf")
    light, detector = directions(m)
    assert_is(near_forward(m, 0.2), apart(detector, -light) < 0.2)
    assert not near_forward(sphere("brdf"), 3.0).any()


def test_the_specular_direction_of_a_surface_mirrors_the_light():
    m = sphere("brdf")
    light, detector = directions(m)
    assert_is(near_specular(m, 0.2), apart(detector, light * [-1, -1, 1]) < 0.2)


def test_the_specular_directions_of_a_fiber_are_a_cone():
    """All around the axis: the detector's component along it is the light's, reversed."""
    m = sphere("phase_function")
    light, detector = directions(m)
    assert_is(near_specular(m, 0.1), np.abs(np.arcsin(detector[:, 0]) + np.arcsin(light[:, 0])) < 0.1)


@pytest.mark.parametrize("quantity", ["brdf", "bcsdf"])
def test_near_the_light(quantity):
    m = sphere(quantity)
    light, detector = directions(m)
    assert_is(near_light(m, 0.3), apart(detector, light) < 0.3)


def test_beyond_an_inclination():
    m = sphere("bcsdf")
    assert_is(beyond(m, 1.3), np.abs(m.theta_o) > 1.3)
    assert beyond(m, 0.5)[m.theta_i > 0.6].all()


def test_a_region_of_a_job_is_where_all_its_conditions_hold():
    m = sphere("phase_function")
    region = MaskRegion(theta_o_deg=(-90.0, 0.0), near_forward_deg=20.0)
    assert_is(in_region(m, region), near_forward(m, np.radians(20)) & (m.theta_o <= 0))
    for name, mask in (("beyond", beyond), ("near_specular", near_specular), ("near_light", near_light)):
        region = MaskRegion.model_validate({f"{name}_deg": 25.0, "phi_deg": (-180.0, 170.0)})
        turned = np.degrees(m.phi_o - m.phi_i)
        turned -= 360 * np.round(turned / 360)
        assert_is(in_region(m, region), mask(m, np.radians(25)) & (turned <= 170))


def test_a_region_without_conditions_is_refused():
    with pytest.raises(ValueError, match="without any condition"):
        MaskRegion()
