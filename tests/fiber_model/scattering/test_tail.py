"""The tails of the longitudinal lobes: what they are made of, energy, reciprocity, samples."""

from __future__ import annotations

from dataclasses import replace
from math import radians

import numpy as np
import pytest
from scipy import integrate, stats

from tests.fiber_model.scattering.scattering_cases import CORNERS, gray, tailed
from tests.fiber_model.scattering.sphere_bins import gauss_points
from weft.fiber_model.scattering.longitudinal import gaussian_eval
from weft.fiber_model.scattering.phase import longitudinal_densities
from weft.fiber_model.scattering.tail import tail_eval, tail_sample

WIDTHS_DEG = (0.5, 2.0, 10.0, 40.0, 120.0)
LIGHTS_DEG = (0.0, 45.0, 80.0, 89.0, -90.0)
ALPHA = 1e-4


def knots(theta_o, width):
    """Dense around the specular cone and toward the poles."""
    steps = np.concatenate([[0.0], np.geomspace(1e-3, 2000, 120)]) * width
    poles = np.pi / 2 - np.geomspace(1e-7, 1.0, 60)
    parts = [-theta_o - steps, -theta_o + steps, poles, -poles, np.linspace(-1, 1, 31) * np.pi / 2]
    return np.unique(np.clip(np.concatenate(parts), -np.pi / 2, np.pi / 2))


@pytest.mark.parametrize("width_deg", WIDTHS_DEG)
@pytest.mark.parametrize("theta_o_deg", LIGHTS_DEG)
def test_normalized(width_deg, theta_o_deg):
    theta_o, width = radians(theta_o_deg), radians(width_deg)
    theta, weight = gauss_points(knots(theta_o, width))
    assert abs((tail_eval(theta_o, theta, width) * np.cos(theta) * weight).sum() - 1) < 1e-7


@pytest.mark.parametrize("theta_i_deg", [-50.0, -47.0, 0.0, 89.0])
def test_is_the_spherical_cauchy_distribution_about_the_specular_cone(theta_i_deg):
    """The closed form against the integral over all places on the cone."""
    theta_o, theta_i, s = radians(50.0), radians(theta_i_deg), radians(6.0) ** 2

    def density(phi):
        cosine = -np.sin(theta_o) * np.sin(theta_i) + np.cos(theta_o) * np.cos(theta_i) * np.cos(phi)
        return s * (s + 2) / (4 * np.pi) / (1 + s - cosine) ** 2

    whole = 2 * integrate.quad(density, 0, np.pi, points=[0.02, 0.1, 0.5], epsabs=0, epsrel=1e-11)[0]
    assert tail_eval(theta_o, theta_i, np.sqrt(s)) == pytest.approx(whole, rel=1e-9)


def test_is_symmetric_in_its_angles():
    theta = np.random.default_rng(3).uniform(-np.pi / 2, np.pi / 2, (2, 1000))
    np.testing.assert_allclose(tail_eval(*theta, 0.1), tail_eval(*theta[::-1], 0.1), rtol=1e-10)


@pytest.mark.parametrize("theta_o_deg", [0.0, 45.0, -89.0])
@pytest.mark.parametrize("width_deg", [0.5, 10.0, 120.0])
def test_samples_follow_it(width_deg, theta_o_deg):
    """Kolmogorov-Smirnov; nine cases together fail by chance once in 10,000."""
    theta_o, width = radians(theta_o_deg), radians(width_deg)
    theta = tail_sample(theta_o, width, *np.random.default_rng(5).random((2, 50_000)))
    cuts = knots(theta_o, width)
    points, weight = gauss_points(cuts)
    mass = (tail_eval(theta_o, points, width) * np.cos(points) * weight).sum(axis=1)
    cumulative = np.concatenate([[0.0], np.cumsum(mass)])
    assert stats.kstest(theta, lambda x: np.interp(x, cuts, cumulative)).pvalue > ALPHA / 9


def test_falls_off_more_slowly_than_a_gaussian():
    """Twelve widths out, where a Gaussian has nothing: as Student's t with two degrees of freedom."""
    width = radians(0.5)
    expected = (1 + 72.0) ** -1.5
    ratio = tail_eval(0.0, 12 * width, width) / tail_eval(0.0, 0.0, width)
    assert ratio == pytest.approx(expected, rel=0.01)
    assert gaussian_eval(0.0, 12 * width, width) / gaussian_eval(0.0, 0.0, width) < 1e-30


def test_a_lobe_without_a_tail_keeps_its_bits():
    bare = gray((3.0, 8.0, 20.0), 40.0)
    theta_o, theta_i = np.random.default_rng(3).uniform(-1.5, 1.5, (2, 1000))
    with_one = tailed(bare, (0.5, None, None), (None,) * 3, (1.0, None, None))
    ours, theirs = (longitudinal_densities(one, theta_o, theta_i) for one in (with_one, bare))
    assert np.abs(ours[0] - theirs[0]).max() > 0.01
    assert np.array_equal(ours[1], theirs[1])
    assert np.array_equal(ours[2], theirs[2])


def test_the_tail_s_part_goes_linearly_with_one_minus_the_cosine():
    """At 60 degrees half way from 0.2 to 0.6, the width with beta."""
    bare = gray((3.0, 8.0, 20.0), 40.0)
    bare = replace(bare, longitudinal_width_r_grazing=radians(9.0))
    one = tailed(bare, (0.2, None, None), (0.6, None, None), (2.0, None, None))
    theta = np.linspace(-1.5, 1.5, 31)
    found = longitudinal_densities(one, radians(60.0), theta)[0]
    body = longitudinal_densities(bare, radians(60.0), theta)[0]
    np.testing.assert_allclose(found, 0.6 * body + 0.4 * tail_eval(radians(60.0), theta, radians(12.0)))


def test_only_media_with_tails_compile_them():
    from weft.renderer.scattering_block import phase_constants

    bare = [one for one in CORNERS.values() if not one.has_tails]
    assert phase_constants(bare)["FIBER_TAILS"] == 0
    assert phase_constants([*bare, CORNERS["tails"]])["FIBER_TAILS"] == 1
