"""Proof: one call of the fit finds the global minimum, whatever the truth and wherever it starts."""

from __future__ import annotations

import time

import numpy as np
import pytest

from tests.fitting.fit_cases import config, problem, random_truth, synthetic, vector_of
from weft.fitting.fit import run
from weft.fitting.projected import polish

TRUTHS = 200
TOLERANCE = 0.01
"""chi² may end this far above the minimum next to the truth: a tenth of one number's sigma."""


def recovery(seed: int, *, gray: bool) -> tuple[bool, float]:
    """Whether one call reached chi² of the minimum next to the truth or below, and its seconds."""
    channels = 1 if gray else 3
    truth = random_truth(np.random.default_rng(seed), gray=gray)
    measured = synthetic(truth, seed=seed, channels=channels)
    residual, parameterization, data = problem(measured)
    nearby = polish(residual, parameterization, data, vector_of(truth, channels))
    begin = time.perf_counter()
    found = run(config(), measured)
    return found.chi2 <= 2 * float(nearby.cost) + TOLERANCE, time.perf_counter() - begin


@pytest.mark.proof
@pytest.mark.parametrize("gray", [True, False], ids=["gray", "rgb"])
def test_one_call_reaches_the_global_minimum(gray, capsys):
    """Of 200 truths at least 99 %, 2 % noise, about 1250 directions at theta_i 0, 30, 60, 75 deg."""
    outcomes = [recovery(seed, gray=gray) for seed in range(TRUTHS)]
    reached = sum(ok for ok, _ in outcomes)
    seconds = np.array([s for _, s in outcomes])
    with capsys.disabled():
        failed = [seed for seed, (ok, _) in enumerate(outcomes) if not ok]
        print(f"\n{'gray' if gray else 'rgb'}: {reached} of {TRUTHS} reached; missed {failed}")
        median, longest = np.median(seconds), seconds[1:].max()
        print(f"seconds a call: median {median:.2f}, after the first {longest:.2f} at most")
    assert reached >= 0.99 * TRUTHS
