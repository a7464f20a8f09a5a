"""Counter-based random numbers."""

from __future__ import annotations

import numpy as np
from scipy import stats

from weft.fiber_model.counter_random import LARGEST_NORMAL, normal_pair, pcg4d, poisson, seed_key, uniform

COUNT = 200_000


def test_words_are_uniform_and_independent() -> None:
    words = [uniform(word) for word in pcg4d(7, np.arange(COUNT), 3, 11)]
    for word in words:
        assert stats.kstest(word, "uniform").pvalue > 1e-4
    correlation = np.corrcoef(np.array([*words, np.roll(words[0], 1)]))
    assert np.abs(correlation - np.eye(5)).max() < 5 / np.sqrt(COUNT)


def test_a_number_depends_on_its_key_alone() -> None:
    together = pcg4d(7, np.arange(100), 3, 11)
    alone = [pcg4d(7, key, 3, 11) for key in reversed(range(100))]
    assert [int(word) for word in together[2]] == [int(words[2]) for words in reversed(alone)]


def test_neighboring_seeds_share_no_keys() -> None:
    keys = {seed_key(seed) for seed in range(1000)}
    assert len(keys) == 1000
    assert min(np.diff(sorted(keys))) > 64  # purposes and draws are added to the key


def test_normals_are_normal_and_bounded() -> None:
    words = pcg4d(1, np.arange(COUNT), 0, 0)
    for normal in normal_pair(words[0], words[1]):
        assert stats.kstest(normal, "norm").pvalue > 1e-4
    extreme = normal_pair(np.zeros(1, np.uint32), np.zeros(1, np.uint32))[0]
    assert 5.7 < extreme[0] <= LARGEST_NORMAL * (1 + 1e-6)


def test_poisson_counts_have_poisson_moments() -> None:
    for mean in (0.0, 0.3, 8.0, 100.0):
        count = poisson(np.full(50_000, mean), 5, 6, np.arange(50_000))
        assert abs(count.mean() - mean) <= 4 * np.sqrt(mean / 50_000)
        assert abs(count.var() - mean) <= 0.05 * mean
