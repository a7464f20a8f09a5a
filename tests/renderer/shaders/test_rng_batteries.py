"""Harder questions to random numbers, as of Marsaglia's Diehard and Knuth: 4 million of them along an index.

Error probability 1e-6 for each p-value, of which there are 7 per generator and index. Asked are the 24 bits
of which numbers are made: along the dimension the lowest 8 bits of pcg4d depend on each other (those of a
product modulo 2^32 know nothing of higher ones), which a test states.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from tests.renderer.probe import probe

pytestmark = [pytest.mark.gl, pytest.mark.proof]

GENERATORS = {"pcg4d": 0, "philox": 1, "md5": 2}
INDICES = {"pixel": 0, "sample": 1, "dimension": 2, "seed": 3}
LEAST = 1e-6
COUNT = 1 << 20


def words(generator: str, index: int, count: int = COUNT) -> np.ndarray:
    """Upper 24 bits for `count` keys that differ in one index, uint32, shape [4 count] in their order."""
    keys = np.tile(np.array([12, 34, 5, 678], np.uint32), (count, 1))
    keys[:, index] += np.arange(count, dtype=np.uint32)
    constants = {"RANDOM_KIND": GENERATORS[generator]}
    bits = probe("rng/random.glsl", "uvec4 random_bits(uvec4 key)", constants=constants)
    return bits(keys).astype(np.uint32).ravel() >> np.uint32(8)


def birthday_spacings(numbers: np.ndarray) -> float:
    """Equal spacings of 1024 birthdays in 2^24 days are Poisson with mean n^3 / (4 m) = 16."""
    days = np.sort(numbers.reshape(-1, 1024), axis=1)
    gaps = np.sort(np.diff(days, axis=1), axis=1)
    equal = (np.diff(gaps, axis=1) == 0).sum(axis=1)
    edges = np.arange(8, 26)
    seen = np.histogram(equal, [0, *edges, 10**6])[0]
    mean = 1024**3 / 2**26
    chance = np.diff([0, *stats.poisson.cdf(edges - 1, mean), 1])
    return stats.chisquare(seen, chance * len(equal)).pvalue


def ranks_of_matrices(numbers: np.ndarray) -> float:
    """Ranks of random 24 x 24 matrices over two elements: 24, 23, 22, or less."""
    rows = numbers[: 24 * 20_000].reshape(-1, 24).copy()
    rank = np.zeros(len(rows), int)
    for bit in range(24):
        has = (rows >> np.uint32(bit)) & 1 == 1
        pivot = has.argmax(axis=1)
        found = has.any(axis=1)
        row = np.where(found, rows[np.arange(len(rows)), pivot], 0).astype(np.uint32)
        rows ^= np.where(has & found[:, None], row[:, None], np.uint32(0))
        rank += found
    chance = [0.2887880950866, 0.5775761901732, 0.1283502644829]
    seen = [(rank == r).sum() for r in (24, 23, 22)]
    seen.append(len(rank) - sum(seen))
    return stats.chisquare(seen, np.array([*chance, 1 - sum(chance)]) * len(rank)).pvalue


def collisions(numbers: np.ndarray) -> float:
    """2^18 balls into 2^24 urns (Knuth 3.3.2 I): about n^2 / (2 m) collisions, nearly Poisson."""
    urns = (numbers.reshape(-1, 2) >> 12) @ np.array([4096, 1])
    urns = urns.reshape(-1, 1 << 18)
    found = sum((1 << 18) - len(np.unique(row)) for row in urns)
    n, m = 1 << 18, 1 << 24
    mean = (n - m * -math.expm1(n * math.log1p(-1 / m))) * len(urns)
    return 2 * min(stats.poisson.cdf(found, mean), stats.poisson.sf(found - 1, mean))


def runs_up_and_down(numbers: np.ndarray) -> float:
    """Their number is normal with mean (2 n - 1) / 3 and variance (16 n - 29) / 90."""
    n = len(numbers)
    rises = np.diff(numbers.astype(np.int64)) > 0
    found = 1 + (rises[1:] != rises[:-1]).sum()
    return 2 * stats.norm.sf(abs(found - (2 * n - 1) / 3) / math.sqrt((16 * n - 29) / 90))


def bits_set(numbers: np.ndarray) -> float:
    """Of pairs of neighbors: bits set are binomial and independent."""
    weight = np.unpackbits(numbers.view(np.uint8)).reshape(-1, 32).sum(axis=1).astype(int)
    low = np.clip(weight, 8, 16) - 8
    chance = np.diff([0, *stats.binom.cdf(np.arange(8, 16), 24, 0.5), 1])
    seen = np.histogram2d(low[:-1:2], low[1::2], bins=9, range=((0, 9), (0, 9)))[0]
    return stats.chisquare(seen.ravel(), np.outer(chance, chance).ravel() * seen.sum()).pvalue


def farther_lags(numbers: np.ndarray) -> float:
    """Correlations at lags up to 64 keys, of all four numbers: the largest of 257, after Sidak."""
    u = numbers.astype(np.float64) - numbers.mean()
    z = [abs((u[: -4 * lag] * u[4 * lag :]).sum()) for lag in (1, 2, 3, 5, 8, 16, 31, 32, 63, 64)]
    z = np.array(z) / (u.var() * math.sqrt(len(u)))
    return -math.expm1(len(z) * math.log1p(-2 * stats.norm.sf(z.max())))


def spheres(numbers: np.ndarray) -> float:
    """Points of four numbers: as many lie within the unit ball as its volume says, pi^2 / 32."""
    u = (numbers.reshape(-1, 4) + 0.5) / 2.0**24
    inside = int(((u**2).sum(axis=1) < 1).sum())
    return stats.binomtest(inside, len(u), math.pi**2 / 32).pvalue


QUESTIONS = (
    birthday_spacings,
    ranks_of_matrices,
    collisions,
    runs_up_and_down,
    bits_set,
    farther_lags,
    spheres,
)


@pytest.mark.parametrize("index", INDICES)
@pytest.mark.parametrize("generator", GENERATORS)
def test_harder_questions(generator, index):
    numbers = words(generator, INDICES[index])
    answers = {question.__name__: question(numbers) for question in QUESTIONS}
    assert min(answers.values()) > LEAST, answers


def test_the_lowest_bits_of_pcg4d_are_weak_and_not_used():
    """Why numbers are made of the upper 24 bits; if this turns green for all 32, they may be used."""
    keys = np.tile(np.array([12, 34, 5, 678], np.uint32), (COUNT, 1))
    keys[:, 2] += np.arange(COUNT, dtype=np.uint32)
    bits = probe("rng/random.glsl", "uvec4 random_bits(uvec4 key)", constants={"RANDOM_KIND": 0})(keys)
    ones = ((bits[..., None] >> np.arange(32, dtype=np.uint32)) & 1).mean(axis=0)  # [4, 32]
    z = np.abs(ones - 0.5) * 2 * math.sqrt(COUNT)
    assert z[:, 0].max() > 100
    assert z[:, 8:].max() < 6  # 96 bits, each beyond 6 by chance 2e-9


def test_a_poor_generator_fails_them():
    """A linear congruential one, as hidden behind many a shader."""
    numbers = np.empty(4 * COUNT, np.uint32)
    state = np.arange(COUNT, dtype=np.uint32)
    for i in range(4):
        state = state * np.uint32(1664525) + np.uint32(1013904223)
        numbers[i::4] = state >> np.uint32(8)
    assert min(question(numbers) for question in QUESTIONS) < 1e-30
