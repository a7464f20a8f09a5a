"""Longitudinal lobes: normalized at every angle, sampled as they are evaluated, vmf symmetric."""

from __future__ import annotations

from math import radians

import numpy as np
import pytest

from tests.fiber_model.scattering.sphere_bins import gauss_points
from weft.fiber_model.scattering.longitudinal import (
    gaussian_eval,
    gaussian_sample,
    vmf_eval,
    vmf_sample,
)

BETAS = [radians(beta) for beta in (0.5, 1, 6, 12, 24, 40, 60)]
THETAS = np.radians([0.0, 30, -60, 85, -89, 90])


def integral(eval_lobe, theta_o, beta, moment):
    edges = np.unique(np.clip(-theta_o + beta * np.linspace(-12, 12, 49), -np.pi / 2, np.pi / 2))
    theta, weight = gauss_points(edges)
    return (eval_lobe(theta_o, theta, beta) * np.cos(theta) * weight * moment(theta)).sum()


@pytest.mark.parametrize("eval_lobe", [gaussian_eval, vmf_eval])
@pytest.mark.parametrize("beta", BETAS)
def test_normalized_at_every_angle(eval_lobe, beta):
    for theta_o in THETAS:
        assert integral(eval_lobe, theta_o, beta, np.ones_like) == pytest.approx(1, abs=1e-7)


@pytest.mark.parametrize("beta", BETAS)
def test_vmf_is_symmetric(beta):
    theta = np.linspace(-1.5, 1.5, 41)
    values = vmf_eval(theta[:, None], theta[None, :], beta)
    np.testing.assert_allclose(values, values.T, rtol=1e-9)


def test_vmf_mean_is_langevin():
    """The mean of a von Mises-Fisher direction is coth(1/v) - v along its center."""
    theta_o, beta = radians(40), radians(30)
    v = beta**2
    mean = integral(vmf_eval, theta_o, beta, np.sin)
    assert mean == pytest.approx(-np.sin(theta_o) * (1 / np.tanh(1 / v) - v), abs=1e-7)


@pytest.mark.parametrize("beta", BETAS)
@pytest.mark.parametrize("moment", [np.sin, np.cos, lambda theta: np.sin(theta) ** 2])
def test_samples_have_the_lobes_moments(beta, moment):
    """z-tests of 84 means; each fails by chance below 1e-6."""
    rng = np.random.default_rng(5)
    for theta_o in (radians(30), radians(-85)):
        for eval_lobe, theta in (
            (gaussian_eval, gaussian_sample(theta_o, beta, rng.random(4000))),
            (vmf_eval, vmf_sample(theta_o, beta, rng.random(4000), rng.random(4000))),
        ):
            mean = integral(eval_lobe, theta_o, beta, moment)
            error = moment(theta).std() / np.sqrt(theta.size)
            assert abs(moment(theta).mean() - mean) < 5 * error


@pytest.mark.parametrize("beta", BETAS)
def test_gaussian_sample_inverts_its_distribution(beta):
    """The integral of the lobe up to sample(u) is u, by quadrature that knows nothing of the closed form."""
    for theta_o in THETAS:
        for u in (1e-4, 0.2, 0.5, 0.9, 0.9999):
            theta = float(gaussian_sample(theta_o, beta, u))
            low = np.clip(-theta_o - 12 * beta, -np.pi / 2, theta)
            points, weight = gauss_points(np.linspace(low, theta, 60))
            below = (gaussian_eval(theta_o, points, beta) * np.cos(points) * weight).sum()
            assert below == pytest.approx(u, abs=1e-8)
