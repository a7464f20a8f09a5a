"""The phase function on JAX: equal to numpy's, and its gradients to finite differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate

from tests.fiber_model.scattering.scattering_cases import CORNERS, PRESET_NAMES, preset
from weft.fiber_model.scattering import longitudinal, phase
from weft.fiber_model.scattering.phase_jax import (
    LobeParameters,
    distinct_directions,
    fiber_phase_eval,
    gaussian_normalization,
    split_parameters,
)

MEDIA = {name: preset(name) for name in PRESET_NAMES} | CORNERS


def random_angles(count, parameters, seed):
    """Half over the whole sphere, half near the specular cone, where narrow lobes live."""
    rng = np.random.default_rng(seed)
    theta_o, theta_i = np.arcsin(rng.uniform(-1, 1, (2, count)))
    widths = np.array(phase.longitudinal_widths(parameters))[np.arange(count) % 3]
    near = np.clip(-theta_o + widths * rng.normal(size=count), -1.57, 1.57)
    theta_i = np.where(np.arange(count) % 2, near, theta_i)
    phi = np.where(
        np.arange(count) % 4 > 1, np.pi + 0.1 * rng.normal(size=count), 7 * rng.uniform(-1, 1, count)
    )
    return theta_o, theta_i, phi


def direction(theta, phi):
    return np.stack([np.sin(theta), np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi)], axis=-1)


@pytest.mark.parametrize("name", MEDIA)
def test_equals_numpy(name):
    angles = random_angles(20_000, MEDIA[name], seed=1)
    kinds, values = split_parameters(MEDIA[name])
    ours = fiber_phase_eval(kinds, values, distinct_directions(*angles))
    theta_o, theta_i, phi = angles
    expected = phase.fiber_phase_eval(MEDIA[name], direction(theta_o, 0 * phi), direction(theta_i, phi))
    # the angles pass through sines and arctangents on numpy's side, whose rounding a lobe of 0.5 deg feels
    np.testing.assert_allclose(ours, expected, rtol=1e-8, atol=1e-11 * expected.max())


@pytest.mark.parametrize("beta_deg", [0.5, 1, 5, 10, 17, 25, 40, 60])
def test_normalization_equals_closed_form(beta_deg):
    theta = np.radians([0.0, 30, 60, 75, 80, 85, 89, 89.9, -50])
    beta = np.radians(beta_deg)
    expected = longitudinal.gaussian_normalization(theta, beta)
    np.testing.assert_allclose(gaussian_normalization(theta, beta), expected, rtol=2e-12)


def test_normalization_equals_adaptive_quadrature():
    beta, theta = np.radians(12.0), np.radians(70.0)

    def integrand(t):
        return np.exp(-0.5 * ((t + theta) / beta) ** 2) / beta / np.sqrt(2 * np.pi) * np.cos(t) ** 2

    expected = integrate.quad(integrand, -np.pi / 2, np.pi / 2, epsabs=1e-14, points=[-theta])[0]
    assert float(gaussian_normalization(theta, beta)) == pytest.approx(expected, rel=1e-12)


COMPILED_ALREADY = ("table", "table of TRT", "table symmetric")
"""Kinds whose derivatives "table rows", "table grazing" and "symmetric" go through."""


@pytest.mark.parametrize(
    "name", ["reference", "khungurn2015_silk", *(name for name in CORNERS if name not in COMPILED_ALREADY)]
)
def test_gradients_equal_finite_differences(name):
    import jax

    parameters = replace(MEDIA[name], azimuthal_width_trt=MEDIA[name].azimuthal_width_trt or 1.0)
    kinds, values = split_parameters(parameters)
    directions = distinct_directions(*random_angles(300, parameters, seed=2))
    evaluate = jax.jit(lambda values: fiber_phase_eval(kinds, values, directions))
    for field in [name for name in LobeParameters._fields if getattr(values, name) is not None]:
        value = getattr(values, field)
        step = value  # d/dlog x; a table is normalized, so every knot goes its own way
        if field.startswith("azimuthal_table"):
            step = value * np.cos(np.arange(value.size).reshape(value.shape))
        tangent = jax.tree.map(np.zeros_like, values)._replace(**{field: step})
        _, slope = jax.jvp(evaluate, (values,), (tangent,))
        high, low = (evaluate(values._replace(**{field: value + h * step})) for h in (1e-5, -1e-5))
        difference = (high - low) / 2e-5
        scale = max(float(abs(difference).max()), float(abs(evaluate(values)).max()))
        np.testing.assert_allclose(slope, difference, rtol=1e-6, atol=1e-7 * scale, err_msg=field)


def test_gradients_are_finite_over_the_whole_range():
    """No branch of the azimuthal lobe, taken or not, may spoil the other's gradient."""
    import jax

    directions = distinct_directions(*random_angles(200, CORNERS["narrow"], seed=3))
    for azimuthal in ("wrapped_normal", "von_mises"):
        for beta, gamma in [(0.5, 2.0), (60.0, 300.0), (10.0, 101.5), (10.0, 101.6)]:
            medium = replace(
                CORNERS["narrow"],
                **{f"longitudinal_width_{k}": np.radians(beta) for k in ("r", "tt", "trt")},
                **{f"azimuthal_width_{k}": np.radians(gamma) for k in ("tt", "trt")},
                azimuthal=azimuthal,
            )
            kinds, values = split_parameters(medium)
            slopes = jax.jacfwd(lambda v, k=kinds: fiber_phase_eval(k, v, directions))(values)
            assert all(np.isfinite(slope).all() for slope in jax.tree.leaves(slopes))


def test_distinct_directions_keep_every_angle():
    theta_o, theta_i, phi = random_angles(1000, CORNERS["wide"], seed=4)
    theta_o, theta_i = np.round(theta_o, 1), np.round(theta_i, 1)
    distinct = distinct_directions(theta_o, theta_i, phi)
    assert len(distinct.theta_o) == len(np.unique(theta_o))
    np.testing.assert_array_equal(distinct.theta_o[distinct.pair_theta_o[distinct.pair]], theta_o)
    np.testing.assert_array_equal(distinct.pair_theta_i[distinct.pair], theta_i)
    np.testing.assert_allclose(
        np.exp(1j * np.asarray(distinct.phi[distinct.around])), np.exp(1j * phi), atol=1e-12
    )
