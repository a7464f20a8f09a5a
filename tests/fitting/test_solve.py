"""The search reaches the global minimum, and the polish obeys bounds."""

from __future__ import annotations

import numpy as np
import pytest

from tests.fitting.fit_cases import problem, random_truth, synthetic, vector_of
from weft.fitting.parameterization import expand
from weft.fitting.projected import free_jacobian, polish
from weft.fitting.solve import EDM_LIMIT, random_starts, solve

import jax  # isort: skip  after weft, which switches it to 64 bits


@pytest.mark.parametrize("seed", range(4))
def test_search_reaches_the_minimum_next_to_the_truth(seed):
    """Noise lowers the minimum's chi² below the truth's; no start may end above that."""
    truth = random_truth(np.random.default_rng(seed))
    residual, parameterization, data = problem(synthetic(truth, seed=seed))
    nearby = polish(residual, parameterization, data, vector_of(truth))
    found = solve(residual, parameterization, data, random_starts(parameterization, 24, 0))
    at_truth = float((residual(vector_of(truth), data) ** 2).sum())
    assert 2 * found.cost <= at_truth
    assert 2 * found.cost <= 2 * float(nearby.cost) + 0.01


def test_starts_follow_the_seed():
    _, parameterization, _ = problem(synthetic(random_truth(np.random.default_rng(0))))
    one, again, other = (random_starts(parameterization, 24, seed) for seed in (0, 0, 1))
    np.testing.assert_array_equal(one, again)
    assert np.abs(one - other).min(axis=1).max() > 0.01


def test_the_jacobian_of_the_polish_equals_finite_differences():
    """Central differences of the residuals in every free parameter."""
    truth = random_truth(np.random.default_rng(2))
    residual, p, data = problem(synthetic(truth, seed=2))
    x = vector_of(truth)
    slopes = np.asarray(free_jacobian(residual, p, data, x))
    evaluate = jax.jit(lambda x: residual(expand(p, x), data))
    for i in np.flatnonzero(p.free):
        step = np.zeros(len(x))
        step[i] = 1e-5 * x[i]
        difference = (evaluate(x + step) - evaluate(x - step)) / (2 * step[i])
        np.testing.assert_allclose(slopes[:, i], difference, atol=1e-6 * np.abs(slopes[:, i]).max())
    assert not slopes[:, p.free == 0].any()


def test_polish_stops_at_a_bound_where_the_gradient_points_outward():
    truth = random_truth(np.random.default_rng(1))
    residual, parameterization, data = problem(synthetic(truth, noise=0.0), noise={"kind": "uniform"})
    parameterization.upper[1] = 0.9 * truth.longitudinal_width_tt
    start = vector_of(truth)
    start[1] *= 0.7  # the way to the minimum leads through the bound
    found = polish(residual, parameterization, data, start)
    assert float(found.x[1]) == parameterization.upper[1]
    assert float(found.edm) < EDM_LIMIT
    gradient = np.asarray(found.jacobian.T @ residual(found.x, data))
    assert gradient[1] < 0
    free = (parameterization.free > 0) & (np.arange(len(gradient)) != 1)
    scale = np.linalg.norm(found.jacobian, axis=0) * np.sqrt(2 * found.cost)
    assert (np.abs(gradient) <= 1e-4 * scale)[free].all()
