"""One phase function three times: numpy, JAX and GLSL agree, relative to the lobe's peak for each wo."""

from __future__ import annotations

import numpy as np
import pytest

from tests.renderer.shaders.test_phase_fiber import INDEX, MEDIA, evaluate, peak, random_directions
from weft.fiber_model.scattering.phase import fiber_phase_eval, fiber_phase_sample

pytestmark = pytest.mark.gl


def angles(w):
    across = np.hypot(w[:, 1], w[:, 2])
    return np.arctan2(w[:, 0], across), np.arctan2(w[:, 2], w[:, 1])


def on_jax(parameters, wo, wi):
    from weft.fiber_model.scattering import phase_jax

    (theta_o, azimuth_o), (theta_i, azimuth_i) = angles(wo), angles(wi)
    directions = phase_jax.distinct_directions(theta_o, theta_i, azimuth_i - azimuth_o)
    return np.asarray(phase_jax.fiber_phase_eval(*phase_jax.split_parameters(parameters), directions))


def largest_errors(name, count):
    """Of GLSL against JAX, and of numpy against JAX; half of wi at random, half where the lobes are."""
    parameters, rng = MEDIA[name], np.random.default_rng(100 + INDEX[name])
    wo, wi = random_directions(rng, count), random_directions(rng, count)
    half = count // 2
    wi[:half] = fiber_phase_sample(parameters, wo[:half], rng.random((half, 4)))[0]
    wo64, wi64 = (w / np.linalg.norm(w, axis=1, keepdims=True) for w in (wo.astype(float), wi.astype(float)))
    top, expected = peak(parameters, wo64)[:, None], on_jax(parameters, wo64, wi64)
    in_glsl, in_numpy = evaluate(INDEX[name], wo, wi), fiber_phase_eval(parameters, wo64, wi64)
    return np.abs((in_glsl - expected) / top).max(), np.abs((in_numpy - expected) / top).max()


@pytest.mark.parametrize(
    "name", ["reference", "vmf", "von Mises", "symmetric", "table grazing", "tails corners"]
)
def test_numpy_jax_and_glsl_agree(name):
    in_glsl, in_numpy = largest_errors(name, 4000)
    assert in_glsl < 1e-5
    assert in_numpy < 1e-9


@pytest.mark.proof
@pytest.mark.parametrize("name", MEDIA)
def test_numpy_jax_and_glsl_agree_on_a_million_inputs(name, record_property):
    """A million over all media."""
    in_glsl, in_numpy = largest_errors(name, 1_000_000 // len(MEDIA) + 1)
    record_property("glsl", in_glsl)
    record_property("numpy", in_numpy)
    assert in_glsl < 1e-5
    assert in_numpy < 1e-9
