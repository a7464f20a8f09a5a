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
"""That a correct fit fails one of the three statements of a test below."""
TWO_SIGMA = 1 - 2 * stats.norm.sf(2)
"""95.45 %"""
SEEDS = range(20)
"""The first is the one whose rows FIT.md lists."""


TABLE_HEAD = (
    "\n| row | numbers | distance² | limit | chance | on a bound | in the region, 20 seeds "
    "| mean distance² |\n" + 8 * "|---" + "|"
)


class Refit(NamedTuple):
    """One fabric's free numbers that ended away from their bounds, and those that ended on one."""

    names: list[str]
    deviations: np.ndarray
    """(fitted - published) / standard error."""
    independent: np.ndarray
    """The same after the correlations are taken out: independent standard normals if the errors are right."""
    at_bound: list[str]

    @property
    def distance(self) -> float:
        """Square of Mahalanobis' distance of the published numbers by the fit's covariance.

        A number on a bound counts as fixed there, so it is the others' distance given that. Bounds cut a cone
        out of the parameters; where its tip is the truth, and given the face on which a fit to Gaussian noise
        ends, the square of its distance along that face is chi-square with a degree of freedom a dimension
        (Kudo 1963, Shapiro 1988). Here the truth lies on a bound or nearer than its error (at most .8 of it).
        """
        return float(self.independent @ self.independent)

    @property
    def chance(self) -> float:
        """That a correct fit is as far or farther away: chi-square, one degree of freedom a number."""
        return float(stats.chi2.sf(self.distance, len(self.names)))


def refit(fabric: str, seed: int, **settings) -> Refit:
    """Noise of its own for each row and seed: 2 % of the value and 0.1 % of the peak."""
    published = preset(f"khungurn2015_{fabric}")
    own_seed = len(FABRICS) * seed + FABRICS.index(fabric)
    result = run(config(**TWO_LOBES, **settings), synthetic(published, seed=own_seed, channels=3))
    truth = to_external_units(vector_of(published, 3))
    chosen, at_bound = [], []
    for i, number in enumerate(result.fitted):
        if number.role != "free" or number.standard_error is None:
            continue
        if number.at_bound:
            # the noise of the data decides on which side of so near a bound the minimum would lie
            assert abs(number.value - truth[i]) <= 0.02, number
            at_bound.append(number.name)
        else:
            chosen.append(i)
    gap = np.array([result.fitted[i].value - truth[i] for i in chosen])
    covariance = result.covariance[np.ix_(chosen, chosen)]
    root = np.linalg.cholesky(covariance)
    names = [result.fitted[i].name for i in chosen]
    return Refit(names, gap / np.sqrt(np.diag(covariance)), np.linalg.solve(root, gap), at_bound)


def both_tails(lower: float, upper: float) -> float:
    return float(min(1.0, 2 * min(lower, upper)))


@pytest.mark.proof
def test_published_parameters_are_found_again(capsys):
    """Two standard errors hold 95.4 % of numbers, not all: of 44, two are expected outside.

    Three tests, each failing a correct fit once in a thousand: how many lie outside 2 sigma (binomial), the
    sum of squares (chi-square, both tails), and the largest of all.
    """
    every = {fabric: refit(fabric, SEEDS[0]) for fabric in FABRICS}
    own = np.concatenate([one.deviations for one in every.values()])
    free = np.concatenate([one.independent for one in every.values()])
    outside, count, largest = int((np.abs(free) > 2).sum()), free.size, float(np.abs(free).max())
    squares = float(free @ free)
    chance = {
        "as many outside 2 sigma": float(stats.binom.sf(outside - 1, count, 1 - TWO_SIGMA)),
        "such a sum of squares": both_tails(stats.chi2.cdf(squares, count), stats.chi2.sf(squares, count)),
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


@pytest.mark.proof
def test_joint_regions_of_the_rows_hold_the_published_ones(capsys):
    """All numbers of a row at once, in the region of 2 sigma (95.45 %): 20 seeds of five rows.

    Three statements, each failing a correct fit once in a thousand: how many rows lie in their region
    (binomial, both tails), the sum of all squared distances (chi-square, both tails) and the distribution of
    the rows' chances, which must be uniform (Kolmogorov-Smirnov). Four starts a fit: that the search finds
    the minimum is test_global_recovery.py's.
    """
    rows = {fabric: [refit(fabric, seed, starts=4) for seed in SEEDS] for fabric in FABRICS}
    every = [one for of_fabric in rows.values() for one in of_fabric]
    inside = sum(one.chance > 1 - TWO_SIGMA for one in every)
    distance, freedom = sum(one.distance for one in every), sum(len(one.names) for one in every)
    law = stats.binom(len(every), TWO_SIGMA)
    chance = {
        "as many in their region": both_tails(law.cdf(inside), law.sf(inside - 1)),
        "such a sum": both_tails(stats.chi2.cdf(distance, freedom), stats.chi2.sf(distance, freedom)),
        "such chances": float(stats.kstest([one.chance for one in every], "uniform").pvalue),
    }
    with capsys.disabled():
        print(TABLE_HEAD)
        for fabric, of_fabric in rows.items():
            print(table_row(fabric, of_fabric))
        print(f"{inside} of {len(every)} rows in their region, sum of distances² {distance:.1f} of {freedom}")
        print(f"chances of a correct fit: {chance}")
    assert min(chance.values()) > CHANCE


def table_row(fabric: str, of_fabric: list[Refit]) -> str:
    """The first seed's row, then what all seeds say."""
    first, count = of_fabric[0], len(of_fabric[0].names)
    limit = stats.chi2.ppf(TWO_SIGMA, count)
    inside = sum(one.chance > 1 - TWO_SIGMA for one in of_fabric)
    mean, freedom = (
        np.mean([one.distance for one in of_fabric]),
        np.mean([len(one.names) for one in of_fabric]),
    )
    cells = (count, f"{first.distance:.2f}", f"{limit:.2f}", f"{first.chance:.3f}", ", ".join(first.at_bound))
    return f"| {fabric} | {' | '.join(map(str, cells))} | {inside} | {mean:.2f} of {freedom:.2f} |"
