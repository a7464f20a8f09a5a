"""Random numbers by key: the published hashes, uniform, uncorrelated along every index."""

from __future__ import annotations

import hashlib
import itertools

import numpy as np
import pytest
from scipy import stats

from tests.renderer.probe import probe
from tests.renderer.shaders.reference import pcg4d

pytestmark = pytest.mark.gl

GENERATORS = {"pcg4d": 0, "philox": 1, "md5": 2}
PIXEL, SAMPLE, DIMENSION, SEED = range(4)


def random4(generator, keys):
    call = probe(
        "rng/random.glsl", "vec4 random4(inout uvec4 rng)", constants={"RANDOM_KIND": GENERATORS[generator]}
    )
    return call(keys)


def keys_along(index, count, *, base=(0, 0, 0, 0)):
    keys = np.tile(np.array(base, np.uint32), (count, 1))
    keys[:, index] += np.arange(count, dtype=np.uint32)
    return keys


def test_pcg4d_equals_its_twin():
    keys = np.random.default_rng(1).integers(0, 2**32, (10_000, 4), dtype=np.uint32)
    np.testing.assert_array_equal(probe("rng/pcg4d.glsl", "uvec4 pcg4d(uvec4 v)")(keys), pcg4d(keys))


def test_philox_gives_the_published_vectors():
    """Known answers of Random123 for philox4x32-10."""
    philox = probe("rng/philox.glsl", "uvec4 philox4x32(uvec4 counter, uvec2 key)")
    ones = 0xFFFFFFFF
    pi = [0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344, 0xA4093822, 0x299F31D0]
    counters = np.array([[0] * 4, [ones] * 4, pi[:4]], np.uint32)
    keys = np.array([[0] * 2, [ones] * 2, pi[4:]], np.uint32)
    expected = [
        [0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8],
        [0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD],
        [0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1],
    ]
    np.testing.assert_array_equal(philox(counters, keys), expected)


def test_md5_is_that_of_the_key_s_16_bytes():
    keys = np.random.default_rng(4).integers(0, 2**32, (200, 4), dtype=np.uint32)
    found = probe("rng/md5.glsl", "uvec4 md5(uvec4 key)")(keys)
    digests = [np.frombuffer(hashlib.md5(key.astype("<u4").tobytes()).digest(), "<u4") for key in keys]
    np.testing.assert_array_equal(found, digests)


@pytest.mark.parametrize("pair", [(0, 1), (2, 3)])
@pytest.mark.parametrize("start", [0, 192])
def test_sobol_pairs_are_nets(pair, start):
    """64 samples of a pixel from a multiple of 64 on: one in each of 64 equal boxes, of every shape."""
    sobol = probe("rng/sobol.glsl", "uvec4 sobol(uvec4 key)")
    for pixel, dimension in [(0, 0), (77, 3), (123_456, 5)]:
        keys = keys_along(SAMPLE, 64, base=(pixel, start, dimension, 9))
        points = sobol(keys)[:, pair].astype(np.float64) / 2**32
        for rows in (1, 2, 4, 8, 16, 32, 64):
            boxes = np.floor(points * [rows, 64 // rows]) @ [64 // rows, 1]
            assert len(set(boxes)) == 64


def test_sobol_is_uniform_over_pixels_and_independent_over_dimensions():
    """Of one sample, over scramblings: chi-square of each number, of pairs in it and across; below 1e-6."""
    sobol = probe("rng/sobol.glsl", "uvec4 sobol(uvec4 key)")
    keys = keys_along(PIXEL, 100_000, base=(0, 5, 2, 1))
    now, later = (sobol(keys + np.uint32([0, 0, step, 0])) / 2.0**32 for step in (0, 1))
    p_values = [stats.chisquare(np.histogram(now[:, i], 256, (0, 1))[0]).pvalue for i in range(4)]
    pairs = list(itertools.combinations(now.T, 2)) + [(now[:, i], later[:, i]) for i in range(4)]
    for a, b in pairs:
        counts = np.histogram2d(a, b, bins=32, range=((0, 1), (0, 1)))[0]
        p_values.append(stats.chisquare(counts.ravel()).pvalue)
    assert min(p_values) > 1e-6


@pytest.mark.parametrize("generator", GENERATORS)
def test_numbers_lie_in_the_unit_interval_and_only_the_dimension_moves(generator):
    keys = np.random.default_rng(2).integers(0, 2**32, (50_000, 4), dtype=np.uint32)
    u, moved = random4(generator, keys)
    assert u.min() >= 0
    assert u.max() < 1
    np.testing.assert_array_equal(moved - keys, np.tile(np.array([0, 0, 1, 0], np.uint32), (len(keys), 1)))


@pytest.mark.parametrize("generator", GENERATORS)
@pytest.mark.parametrize("index", [PIXEL, SAMPLE, DIMENSION, SEED])
def test_uniform_and_uncorrelated_along_an_index(generator, index):
    """Chi-square of each number, of pairs and of neighbors; 14 tests, each below 1e-6 by chance."""
    u, _ = random4(generator, keys_along(index, 100_000, base=(3, 5, 7, 11)))
    p_values = [stats.chisquare(np.histogram(u[:, i], 256, (0, 1))[0]).pvalue for i in range(4)]
    pairs = [(u[:, i], u[:, j]) for i, j in itertools.combinations(range(4), 2)]
    pairs += [(u[:-1, i], u[1:, i]) for i in range(4)]
    for a, b in pairs:
        counts = np.histogram2d(a, b, bins=32, range=((0, 1), (0, 1)))[0]
        p_values.append(stats.chisquare(counts.ravel()).pvalue)
    assert min(p_values) > 1e-6


@pytest.mark.parametrize("generator", GENERATORS)
def test_triples_of_one_path_fill_the_cube(generator):
    """Three successive dimensions of many pixels, chi-square over 16³ cells; below 1e-6 by chance."""
    keys = keys_along(PIXEL, 100_000)
    triple = [random4(generator, keys + np.array([0, 0, d, 0], np.uint32))[0][:, 0] for d in range(3)]
    counts = np.histogramdd(np.stack(triple, axis=-1), bins=16, range=[(0, 1)] * 3)[0]
    assert stats.chisquare(counts.ravel()).pvalue > 1e-6


def test_normals_are_normal():
    """Kolmogorov-Smirnov of both numbers and a chi-square of their pairs; below 1e-6 by chance."""
    normals = probe("rng/random.glsl", "vec2 standard_normals(vec2 u)", constants={"RANDOM_KIND": 0})
    n = normals(np.random.default_rng(3).random((100_000, 2))).astype(np.float64)
    assert stats.kstest(n[:, 0], "norm").pvalue > 1e-6
    assert stats.kstest(n[:, 1], "norm").pvalue > 1e-6
    counts = np.histogram2d(*stats.norm.cdf(n).T, bins=32, range=((0, 1), (0, 1)))[0]
    assert stats.chisquare(counts.ravel()).pvalue > 1e-6
    assert np.all(np.isfinite(normals(np.array([[0.0, 0.5], [1 - 2**-24, 0.5]]))))
