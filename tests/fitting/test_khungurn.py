"""Khungurn's five fabrics: evaluated, noised, refitted."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from scipy import stats

from tests.fiber_model.scattering.scattering_cases import preset
from tests.fitting.fit_cases import config, synthetic, vector_of
from weft.fitting.fit import run
from weft.fitting.parameterization import to_external_units

FABRICS = ("fleece", "gabardine", "silk", "cotton", "polyester")
TWO_LOBES = {
    "gamma_trt": False,
    "parameters": {"color_r": {"fixed": 1.0}, "fresnel_tt": {"fixed": 1.0}, "color_trt": {"fixed": 1.0}},
}
"""F_R per channel is their C_R; C_R := 1 and T := 1, so there is no TRT."""
CHANCE = 1e-3
"""That a correct fit fails one of the three tests below."""


class Refit(NamedTuple):
    """One fabric's free numbers that ended away from their bounds."""

    names: list[str]
    deviations: np.ndarray
    """(fitted - published) / standard error."""
    independent: np.ndarray
    """The same after the correlations are taken out: independent standard normals if the errors are right."""


def refit(fabric: str, seed: int) -> Refit:
    """Noise of its own for each fabric: 2 % of the value and 0.1 % of the peak."""
    published = preset(f"khungurn2015_{fabric}")
    result = run(config(**TWO_LOBES), synthetic(published, seed=seed, channels=3))
    truth = to_external_units(vector_of(published, 3))
    chosen = []
    for i, number in enumerate(result.fitted):
        if number.role != "free" or number.standard_error is None:
            continue
        if number.at_bound:
            # the noise of the data decides on which side of so near a bound the minimum would lie
            assert abs(number.value - truth[i]) <= 0.02, number
        else:
            chosen.append(i)
    gap = np.array([result.fitted[i].value - truth[i] for i in chosen])
    covariance = result.covariance[np.ix_(chosen, chosen)]
    root = np.linalg.cholesky(covariance)
    names = [result.fitted[i].name for i in chosen]
    return Refit(names, gap / np.sqrt(np.diag(covariance)), np.linalg.solve(root, gap))


@pytest.mark.proof
def test_published_parameters_are_found_again(capsys):
    """Two standard errors hold 95.4 % of numbers, not all: of 44, two are expected outside.

    Three tests, each failing a correct fit once in a thousand: how many lie outside 2 sigma (binomial), the
    sum of squares (chi-square, both tails), and the largest of all.
    """
    every = {fabric: refit(fabric, seed) for seed, fabric in enumerate(FABRICS)}
    own = np.concatenate([one.deviations for one in every.values()])
    free = np.concatenate([one.independent for one in every.values()])
    outside, count, largest = int((np.abs(free) > 2).sum()), free.size, float(np.abs(free).max())
    squares = float(free @ free)
    both_tails = 2 * min(stats.chi2.sf(squares, count), stats.chi2.cdf(squares, count))
    chance = {
        "as many outside 2 sigma": float(stats.binom.sf(outside - 1, count, 2 * stats.norm.sf(2))),
        "such a sum of squares": both_tails,
        "as large a deviation": 1 - (1 - 2 * stats.norm.sf(largest)) ** count,
    }
    with capsys.disabled():
        for fabric, one in every.items():
            listed = ", ".join(f"{n} {d:+.2f}" for n, d in zip(one.names, one.deviations, strict=True))
            print(f"\n{fabric}: {len(one.names)} of 9 free of bounds: {listed}")
        print(f"within 2 sigma: {(np.abs(own) <= 2).sum()} of {count}; largest {np.abs(own).max():.2f}")
        print(f"without correlations: {count - outside} of {count}; largest {largest:.2f}")
        print(f"sum of squares {squares:.1f}; chances of a correct fit: {chance}")
    assert min(chance.values()) > CHANCE
