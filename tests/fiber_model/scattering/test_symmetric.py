"""The kind `symmetric`: reciprocal and energy-conserving at once, with the Fresnel term inside."""

from __future__ import annotations

import itertools
from dataclasses import replace
from math import radians

import numpy as np
import pytest

from tests.fiber_model.scattering.scattering_cases import gray, preset
from tests.fiber_model.scattering.sphere_bins import direction, gauss_points
from weft.fiber_model.scattering.phase import fiber_phase_albedo, fiber_phase_eval
from weft.fiber_model.scattering.symmetric import (
    MARGINALS,
    log_q_at,
    marginal_energy,
    symmetric_eval,
    symmetric_lobe,
    symmetric_sample,
)

BETAS = (0.5, 1.0, 2.0, 3.0, 6.0, 12.0, 24.0, 40.0, 60.0)
THETAS = np.radians([*np.linspace(0, 88, 45), 89.0, 89.9, 89.99])
ENERGY_ERROR = {0.5: 5e-5, 1.0: 2e-5}
"""Of a lobe whose width is that many degrees; 5e-6 from 2 degrees on. Interpolating the table makes it."""


def energy_errors(beta_deg, marginal):
    """(∫ M cos(theta_i) dtheta_i - 1) a(theta_o) at THETAS."""
    beta, found = radians(beta_deg), []
    for theta_o in THETAS:
        around = -theta_o + beta * np.linspace(-12, 12, 97)
        edges = np.unique(np.clip([*around, *np.linspace(-np.pi, np.pi, 361) / 2], -np.pi / 2, np.pi / 2))
        theta, weight = gauss_points(edges)
        found.append((symmetric_eval(theta_o, theta, beta, marginal) * np.cos(theta) * weight).sum() - 1)
    return np.array(found) * marginal_energy(marginal, np.cos(THETAS))


@pytest.mark.parametrize("marginal", MARGINALS)
@pytest.mark.parametrize("beta_deg", BETAS)
def test_conserves_energy(beta_deg, marginal):
    """Promised to 1e-3 for 2 to 40 degrees; 50 angles to 89.99 degrees."""
    assert np.abs(energy_errors(beta_deg, marginal)).max() < ENERGY_ERROR.get(beta_deg, 5e-6)


def dyed(kind, beta_deg):
    """Different Schlick terms and colors per channel."""
    return replace(
        gray((beta_deg, beta_deg, beta_deg), 30.0, gamma_trt_deg=50.0, longitudinal=kind),
        fresnel_r=(0.01, 0.2, 0.7),
        color_r=(1.0, 0.5, 0.9),
        color_tt=(0.9, 0.3, 0.6),
        color_trt=(0.2, 0.8, 0.5),
    )


def reciprocity_error(parameters):
    """Largest |cos_o f(wo, wi) - cos_i f(wi, wo)| over its largest value for this wo; [channels]."""
    wo = direction(np.radians([0.0, 30.0, 60.0, 80.0, 88.0])[:, None, None], 0.0)
    wi = direction(np.radians(np.linspace(-89.5, 89.5, 359))[:, None], np.radians([0.0, 60.0, 170.0]))
    wo, wi = np.broadcast_arrays(wo, wi)
    cos_o, cos_i = (np.hypot(w[..., 1], w[..., 2])[..., None] for w in (wo, wi))
    forward, back = cos_o * fiber_phase_eval(parameters, wo, wi), cos_i * fiber_phase_eval(parameters, wi, wo)
    return (np.abs(forward - back) / forward.max(axis=(1, 2), keepdims=True)).max(axis=(0, 1, 2))


@pytest.mark.parametrize("beta_deg", BETAS)
def test_is_reciprocal_in_every_channel(beta_deg):
    """sigma_t(wo) f_p(wo -> wi) = sigma_t(wi) f_p(wi -> wo), sigma_t as cos(theta); promised to 1e-3."""
    assert np.all(reciprocity_error(dyed("symmetric", beta_deg)) < 1e-12)


def test_the_gaussian_kind_is_not_reciprocal():
    """So the test above can tell."""
    assert np.all(reciprocity_error(dyed("gaussian", 12.0)) > 0.1)


def furnace_errors(parameters):
    """|∫ f_p dwi - Σ a_k| per channel at a few angles, by quadrature over the sphere."""
    errors = []
    for theta_o in np.radians([0.0, 40.0, 70.0, 85.0, 89.0]):
        edges = np.unique(np.clip(-theta_o + np.radians(np.linspace(-180, 180, 721)), -np.pi / 2, np.pi / 2))
        theta, weight = (values.ravel() for values in gauss_points(edges))
        phi = 2 * np.pi * np.arange(96) / 96
        wo = direction(theta_o, 0.0)
        value = fiber_phase_eval(parameters, wo, direction(theta[:, None], phi)).mean(axis=1) * 2 * np.pi
        total = (value * (weight * np.cos(theta))[:, None]).sum(axis=0)
        errors.append(np.abs(total - fiber_phase_albedo(parameters, wo)))
    return np.array(errors)


@pytest.mark.parametrize("beta_deg", [2.0, 12.0, 40.0])
def test_furnace_in_every_channel(beta_deg):
    assert furnace_errors(dyed("symmetric", beta_deg)).max() < 5e-6


@pytest.mark.parametrize("name", ["reference", "khungurn2015_silk"])
def test_presets_keep_their_albedo(name):
    """Another shape, the same energy."""
    wo = direction(np.linspace(-1.5, 1.5, 31), 0.0)
    gaussian, symmetric = (preset(name, longitudinal=kind) for kind in ("gaussian", "symmetric"))
    np.testing.assert_allclose(
        fiber_phase_albedo(symmetric, wo), fiber_phase_albedo(gaussian, wo), rtol=1e-12, atol=1e-15
    )


@pytest.mark.parametrize("marginal", MARGINALS)
def test_a_narrow_lobe_is_locally_gaussian(marginal):
    """q sqrt(a) cos -> 1 away from the poles (and from where `grazing` vanishes)."""
    lobe = symmetric_lobe(marginal, radians(0.5))
    theta = np.linspace(0.8, 1.3, 20)
    expected = -np.log(np.cos(theta)) - 0.5 * np.log(marginal_energy(marginal, np.cos(theta)))
    np.testing.assert_allclose(log_q_at(lobe, theta), expected, atol=2e-3)


@pytest.mark.parametrize(("beta_deg", "marginal"), list(itertools.product((0.5, 6.0, 60.0), MARGINALS)))
def test_samples_invert_the_distribution(beta_deg, marginal):
    """The integral of the lobe up to sample(u) is u; quadrature of another rule."""
    beta = radians(beta_deg)
    for theta_o in np.radians([25.0, -60.0, 89.0]):
        u = np.array([1e-4, 0.2, 0.5, 0.9, 0.9999])
        theta = symmetric_sample(theta_o, beta, marginal, u)
        ends = np.clip([-theta_o - 12 * beta, -theta_o + 12 * beta], -np.pi / 2, np.pi / 2)
        fine = np.linspace(*ends, 20_001)
        density = symmetric_eval(theta_o, fine, beta, marginal) * np.cos(fine)
        below = np.concatenate([[0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(fine))])
        np.testing.assert_allclose(np.interp(theta, fine, below / below[-1]), u, atol=2e-6)
