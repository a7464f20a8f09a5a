"""The fit against scipy's trf with finite differences, bounds and x_scale='jac', from the same starts.

Both minimize the same compiled residual; scipy gets the amplitudes of the starts drawn at random, since it
does not solve for them.
"""

from __future__ import annotations

import time

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import optimize

from tests.fitting.fit_cases import problem, random_truth, synthetic, vector_of
from weft.fitting.parameterization import SHAPE_COUNT, expand, widths_from_unbounded
from weft.fitting.projected import polish
from weft.fitting.solve import random_starts, solve

TRUTHS = 6
STARTS = 12
TOLERANCE = 0.01


def scipy_fits(residual, p, data, starts):
    """Costs of all starts, and seconds."""
    free = np.flatnonzero(p.free)
    evaluate = jax.jit(lambda x: residual(expand(p, x), data))
    evaluate(jnp.asarray(p.held)).block_until_ready()
    amplitudes = np.random.default_rng(1).uniform(0.05, 0.95, (len(starts), len(p.free)))
    costs, begin = [], time.perf_counter()
    for z, random in zip(starts, amplitudes, strict=True):
        x = np.clip(random, p.lower, p.upper)
        x[:SHAPE_COUNT] = widths_from_unbounded(p, z)

        def of_free(values, x=x):
            full = x.copy()
            full[free] = values
            return np.asarray(evaluate(full))

        bounds = (p.lower[free], p.upper[free])
        costs.append(optimize.least_squares(of_free, x[free], bounds=bounds, x_scale="jac").cost)
    return np.array(costs), time.perf_counter() - begin


@pytest.mark.benchmark
def test_success_and_time(capsys):
    ours = theirs = theirs_single = 0
    seconds = {"weft": [], "scipy": []}
    for seed in range(TRUTHS):
        truth = random_truth(np.random.default_rng(seed))
        residual, p, data = problem(synthetic(truth, seed=seed))
        limit = float(polish(residual, p, data, vector_of(truth)).cost) + TOLERANCE / 2
        starts = random_starts(p, STARTS, 0)
        if seed == 0:
            solve(residual, p, data, starts)  # compile
        begin = time.perf_counter()
        ours += solve(residual, p, data, starts).cost <= limit
        seconds["weft"].append(time.perf_counter() - begin)
        costs, spent = scipy_fits(residual, p, data, starts)
        seconds["scipy"].append(spent)
        theirs += costs.min() <= limit
        theirs_single += int((costs <= limit).sum())
    ratio = np.median(seconds["scipy"]) / np.median(seconds["weft"])
    with capsys.disabled():
        print(f"\n{TRUTHS} truths, {STARTS} starts each; reached: chi² of the minimum next to the truth")
        print(f"weft: {ours} of {TRUTHS} reached, median {np.median(seconds['weft']):.2f} s a truth")
        print(
            f"scipy trf: {theirs} of {TRUTHS} by the best start, {theirs_single} of {TRUTHS * STARTS} single "
            f"starts, median {np.median(seconds['scipy']):.2f} s a truth: {ratio:.1f} times weft's"
        )
