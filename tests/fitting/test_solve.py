"""The search reaches the global minimum, and the polish obeys bounds."""

from __future__ import annotations

import numpy as np
import pytest

from tests.fitting.fit_cases import problem, random_truth, synthetic, vector_of
from weft.fitting.projected import polish
from weft.fitting.solve import EDM_LIMIT, random_starts, solve


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


def test_polish_stops_at_a_bound_where_the_gradient_points_outward():
    truth = random_truth(np.random.default_rng(1))
    residual, parameterization, data = problem(synthetic(truth, noise=0.0), noise={"kind": "uniform"})
    parameterization.upper[1] = 0.9 * truth.longitudinal_width_tt
    found = polish(residual, parameterization, data, vector_of(truth))
    assert float(found.x[1]) == parameterization.upper[1]
    assert float(found.edm) < EDM_LIMIT
    gradient = np.asarray(found.jacobian.T @ residual(found.x, data))
    assert gradient[1] < 0
    free = (parameterization.free > 0) & (np.arange(len(gradient)) != 1)
    scale = np.linalg.norm(found.jacobian, axis=0) * np.sqrt(2 * found.cost)
    assert (np.abs(gradient) <= 1e-4 * scale)[free].all()
