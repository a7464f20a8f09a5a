"""Isotropic scattering: every direction alike."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from tests.renderer.probe import probe

pytestmark = pytest.mark.gl

PIECE = "phase/isotropic.glsl"
WO = np.array([0.0, 0, 1])


def test_normalized():
    evaluate = probe(PIECE, "float isotropic_eval(vec3 wo, vec3 wi)")
    pdf = probe(PIECE, "float isotropic_pdf(vec3 wo, vec3 wi)")
    assert evaluate(WO, WO) * 4 * np.pi == pytest.approx(1, abs=1e-6)
    assert pdf(WO, WO) == evaluate(WO, WO)


def test_sample_matches_pdf():
    """Chi-square over 20 x 20 bins of equal solid angle; fails by chance below 1e-5."""
    sample = probe(PIECE, "vec3 isotropic_sample(vec3 wo, vec2 u)")
    wi = sample(WO, np.random.default_rng(1).random((100_000, 2)))
    assert np.abs(np.linalg.norm(wi, axis=1) - 1).max() < 1e-6
    turn = np.arctan2(wi[:, 1], wi[:, 0]) / np.pi
    counts = np.histogram2d(wi[:, 2], turn, bins=20, range=((-1, 1), (-1, 1)))[0]
    assert stats.chisquare(counts.ravel()).pvalue > 1e-5
