"""SGGX's specular phase function: equal to its twin, exactly sampled, reciprocal with its extinction."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from tests.renderer.probe import probe
from tests.renderer.shaders.reference import sggx

pytestmark = pytest.mark.gl

PIECE = "phase/sggx.glsl"
sggx_eval = probe(PIECE, "float sggx_eval(vec3 wo, vec3 wi, float r)")
sggx_pdf = probe(PIECE, "float sggx_pdf(vec3 wo, vec3 wi, float r)")
sggx_area = probe(PIECE, "float sggx_area(vec3 w, float r)")
sggx_sample = probe(PIECE, "vec3 sggx_sample(vec3 wo, float r, vec2 u)")

ROUGHNESSES = [0.1, 0.3, 1.0]
VIEWS = [(0.36, -0.48, 0.8), (1.0, 0.0, 0.0), (0.0, 0.6, -0.8)]


def directions(count, seed=1):
    w = np.random.default_rng(seed).normal(size=(count, 3))
    return (w / np.linalg.norm(w, axis=1, keepdims=True)).astype(np.float32)


def sphere_cells(rows, columns, fine):
    """Directions [rows, columns, fine^2, 3] of equal solid angles, in cells even in x and azimuth."""
    x = (np.arange(rows * fine) + 0.5) / (rows * fine) * 2 - 1
    phi = (np.arange(columns * fine) + 0.5) / (columns * fine) * 2 * np.pi - np.pi
    side = np.sqrt(1 - x**2)[:, None]
    w = np.stack(
        [np.broadcast_to(x[:, None], (len(x), len(phi))), side * np.cos(phi), side * np.sin(phi)], axis=-1
    )
    cells = w.reshape(rows, fine, columns, fine, 3).transpose(0, 2, 1, 3, 4)
    return cells.reshape(rows, columns, fine * fine, 3)


@pytest.mark.parametrize("r", ROUGHNESSES)
def test_equals_its_twin(r):
    wo, wi = directions(20_000), directions(20_000, 2)
    expected = sggx(wo, wi, np.diag([r**2, 1, 1]))
    np.testing.assert_allclose(sggx_eval(wo, wi, r), expected, rtol=2e-3, atol=1e-5)
    np.testing.assert_array_equal(sggx_eval(wo, wi, r), sggx_pdf(wo, wi, r))


@pytest.mark.parametrize("r", ROUGHNESSES)
@pytest.mark.parametrize("view", VIEWS)
def test_samples_follow_the_pdf(view, r):
    """Normalized to 2e-3, and chi-square over 20 x 20 cells; all nine together fail by chance below 1e-4."""
    wo, count = np.array(view), 100_000
    cells = sphere_cells(20, 20, 100)
    expected = sggx(wo, cells, np.diag([r**2, 1, 1])).mean(axis=-1) * 4 * np.pi / 400
    assert expected.sum() == pytest.approx(1, abs=2e-3)
    wi = sggx_sample(wo, r, np.random.default_rng(3).random((count, 2))).astype(np.float64)
    assert np.abs(np.linalg.norm(wi, axis=1) - 1).max() < 1e-5
    azimuth = np.arctan2(wi[:, 2], wi[:, 1])
    counts = np.histogram2d(wi[:, 0], azimuth, (20, 20), ((-1, 1), (-np.pi, np.pi)))[0]
    likely = expected * count > 10
    seen, wished = counts[likely], expected[likely]
    if not likely.all():
        seen, wished = np.append(seen, counts[~likely].sum()), np.append(wished, expected[~likely].sum())
    assert stats.chisquare(seen, wished / wished.sum() * count).pvalue > 1e-5


@pytest.mark.parametrize("r", ROUGHNESSES)
def test_reciprocal_with_the_projected_area(r):
    wo, wi = directions(5_000), directions(5_000, 2)
    np.testing.assert_allclose(
        sggx_eval(wo, wi, r) * sggx_area(wo, r), sggx_eval(wi, wo, r) * sggx_area(wi, r), rtol=1e-3
    )
