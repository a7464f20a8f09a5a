"""Proof: intervals contain the truth as often as they say."""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from tests.fitting.fit_cases import problem, synthetic, vector_of
from weft.fiber_model.scattering.parameters import FiberScatteringParameters
from weft.fitting.problem import REWEIGHTINGS
from weft.fitting.projected import polish
from weft.fitting.uncertainty import estimate, quantile

REPEATS = 300
NOISE, FLOOR = 0.02, 0.001
TRUTH = FiberScatteringParameters(
    *np.radians([6.0, 12.0, 24.0, 40.0]),
    fresnel_r=(0.1,) * 3,
    fresnel_tt=0.7,
    color_tt=(0.8,) * 3,
    color_trt=(0.8**1.9,) * 3,
    azimuthal_width_trt=np.radians(60.0),
)
"""Well identified: no width near another, no number near a bound."""


@partial(jax.jit, static_argnames=("residual",))
def refit(residual, p, data, values, weights, x):
    def one(job):
        drawn, weight, start = job
        found = polish(residual, p, data._replace(values=drawn, weights=weight), start)
        return found.x, found.jacobian, found.edm

    return jax.lax.map(one, (values, weights, x), batch_size=50)


def repeated_fits(repeats):
    """Uncertainties and parameters of fits to fresh noise, sigma following the fitted values as in a fit."""
    from weft.fitting.residuals import predict

    measured = synthetic(TRUTH, noise=0.0, lights_deg=(0.0, 40.0, 70.0))
    residual, p, data = problem(measured, noise={"kind": "relative"})
    used = np.asarray(data.weights) > 0
    exact = np.asarray(data.values)
    peak = np.abs(exact).max(axis=0)
    noise = np.random.default_rng(11).normal(size=(repeats, *exact.shape))
    values = exact + np.hypot(NOISE * exact, FLOOR * peak) * noise
    expected, x = values, np.tile(vector_of(TRUTH), (repeats, 1))
    for _ in range(1 + REWEIGHTINGS):
        weights = used / np.hypot(NOISE * expected, FLOOR * peak)
        x, jacobian, edm = map(np.asarray, refit(residual, p, data, values, weights, x))
        expected = np.asarray(
            jax.lax.map(lambda full: predict(residual.kinds, 1, full, data), jnp.asarray(x), batch_size=50)
        )
    assert edm.max() < 1e-6
    for i in range(repeats):
        r = (weights[i] * (expected[i] - values[i])).ravel()
        yield x[i], estimate(residual, p, x[i], jacobian[i], r, absolute=False), p.free > 0


@pytest.mark.proof
def test_intervals_cover_the_truth(capsys):
    """68 % and 95 % within 3 % over all free numbers of 300 repeats.

    If the numbers were independent, a correct fit would miss 3 % at 68 % with probability 0.2 %. Single
    numbers may be off by four binomial standard deviations (probability 1e-3 for all sixteen).
    """
    truth = vector_of(TRUTH)
    inside = {0.68: [], 0.95: []}
    for x, uncertainty, free in repeated_fits(REPEATS):
        gap = np.abs(x - truth)[free] / uncertainty.standard_errors[free]
        for level, hits in inside.items():
            hits.append(gap <= quantile(level, uncertainty))
    for level, hits in inside.items():
        single, together = np.mean(hits, axis=0), float(np.mean(hits))
        with capsys.disabled():
            print(f"\n{level:.0%} intervals contain the truth {together:.1%}; each: {np.round(single, 3)}")
        assert abs(together - level) <= 0.03
        assert (np.abs(single - level) <= 4 * stats.binom.std(REPEATS, level) / REPEATS).all()
