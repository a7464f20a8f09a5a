"""Relaxation of a repeat: contact, length, and the nearest points of segments."""

import numpy as np
import pytest

from weft.fiber_model.yarns.fabrics.relax import closest_parameters, relax_repeat


def test_closest_points_of_segments_match_a_search():
    random = np.random.default_rng(5)
    a, b, apart = random.normal(size=(3, 200, 3))
    u, v = closest_parameters(a, b, apart)
    found = np.linalg.norm(apart + v[:, None] * b - u[:, None] * a, axis=1)
    grid = np.linspace(0, 1, 201)
    everywhere = (
        apart[:, None, None]
        + grid[None, None, :, None] * b[:, None, None]
        - grid[None, :, None, None] * a[:, None, None]
    )
    best = np.linalg.norm(everywhere, axis=-1).min(axis=(1, 2))
    assert (found <= best + 1e-12).all()
    assert found == pytest.approx(best, abs=0.02)


def line(y, z, *, count=32, width=4.0):
    x = np.arange(count) / count * width
    return np.stack([x, np.full(count, y), np.full(count, z)], axis=1)


def test_lines_are_pushed_to_touching_also_across_the_repeat():
    """Of three straight yarns two overlap, one of them with the third of the repeat below."""
    courses = np.stack([line(0.0, 0.0), line(0.5, 0.1), line(2.7, 0.05)])
    relaxed = relax_repeat(courses, (4.0, 3.0), 0.35, rest=np.full(3, 4.0 / 32))
    heights = relaxed.mean(axis=1)
    gaps = [heights[1] - heights[0], heights[2] - heights[1], heights[0] + [0, 3.0, 0] - heights[2]]
    assert [np.linalg.norm(gap[1:]) for gap in gaps] == pytest.approx([0.714, 1.6, 0.714], abs=0.1)
    assert min(np.linalg.norm(gap[1:]) for gap in gaps) >= 0.7


def test_slack_yarn_takes_its_length_in_a_smooth_wave():
    courses = line(0.0, 0.0)[None] + 0.4 * np.sin(2 * np.pi * np.arange(32) / 32)[None, :, None] * [0, 0, 1]
    relaxed = relax_repeat(courses, (4.0, 9.0), 0.1, rest=np.array([1.2 * 4.0 / 32]))[0]
    chords = np.linalg.norm(np.diff(relaxed, axis=0, append=relaxed[:1] + np.array([4.0, 0, 0])), axis=1)
    assert chords == pytest.approx(np.full(32, 1.2 * 4.0 / 32), rel=0.05)
    assert np.ptp(relaxed[:, 2]) > 1.0
