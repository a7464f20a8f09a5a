"""Henyey and Greenstein's phase function: equal to its twin, normalized, exactly sampled."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from tests.fiber_model.scattering.sphere_bins import gauss_points
from tests.renderer.probe import probe
from tests.renderer.shaders.reference import henyey_greenstein

pytestmark = pytest.mark.gl

PIECE = "phase/henyey_greenstein.glsl"
hg_eval = probe(PIECE, "float henyey_greenstein_eval(vec3 wo, vec3 wi, float g)")
hg_pdf = probe(PIECE, "float henyey_greenstein_pdf(vec3 wo, vec3 wi, float g)")
hg_sample = probe(PIECE, "vec3 henyey_greenstein_sample(vec3 wo, float g, vec2 u)")

GS = [-0.9, -0.3, 0.0, 0.5, 0.9, 0.99]
WO = np.array([0.36, -0.48, 0.8])


def directions(count):
    w = np.random.default_rng(1).normal(size=(count, 3))
    return (w / np.linalg.norm(w, axis=1, keepdims=True)).astype(np.float32)


@pytest.mark.parametrize("g", GS)
def test_equals_its_twin(g):
    wi = directions(20_000)
    expected = henyey_greenstein(WO, wi, g)
    np.testing.assert_allclose(hg_eval(WO, wi, g), expected, rtol=2e-4, atol=1e-6 * expected.max())
    np.testing.assert_array_equal(hg_eval(WO, wi, g), hg_pdf(WO, wi, g))


@pytest.mark.parametrize("g", GS)
def test_normalized(g):
    cos_turn, weight = (part.ravel() for part in gauss_points(-np.cos(np.linspace(0, np.pi, 300))))
    wi = np.stack([np.sqrt(1 - cos_turn**2), 0 * cos_turn, -cos_turn], axis=-1)
    values = hg_eval(np.array([0.0, 0, 1]), wi, g).astype(np.float64)
    assert 2 * np.pi * (values * weight).sum() == pytest.approx(1, abs=2e-5)


@pytest.mark.parametrize("g", GS)
def test_sample_matches_pdf(g):
    """Chi-square over 40 x 20 bins of equal probability; fails by chance below 1e-5 each."""
    count = 100_000
    wi = hg_sample(WO, g, np.random.default_rng(2).random((count, 2))).astype(np.float64)
    assert np.abs(np.linalg.norm(wi, axis=1) - 1).max() < 1e-6
    cos_turn = -(wi @ WO)
    # the cumulative distribution of the cosine, elementary for this phase function
    below = (
        (1 + cos_turn) / 2
        if g == 0
        else (1 - g**2) / (2 * g) * ((1 + g**2 - 2 * g * cos_turn) ** -0.5 - 1 / (1 + g))
    )
    side = np.cross(WO, [1.0, 0, 0])
    turn = np.arctan2(wi @ np.cross(WO, side), wi @ side) / (2 * np.pi) + 0.5
    counts = np.histogram2d(np.clip(below, 0, 1), turn, bins=(40, 20), range=((0, 1), (0, 1)))[0]
    assert stats.chisquare(counts.ravel()).pvalue > 1e-5


def test_mean_cosine_is_g():
    for g in GS:
        wi = hg_sample(WO, g, np.random.default_rng(3).random((50_000, 2)))
        cos_turn = -(wi @ WO)
        assert abs(cos_turn.mean() - g) < 5 * cos_turn.std() / np.sqrt(len(wi)) + 1e-6
