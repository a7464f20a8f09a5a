"""Zhao, Luan and Bala 2016, equation 3."""

from __future__ import annotations

import numpy as np
import pytest

from weft.fiber_model.fiber_curves import FiberSelection, export_curves
from weft.fiber_model.fibers import run
from weft.fiber_model.migration import migration_period_index, migration_radius

ALL = (
    *("cotton1", "cotton2", "polyester1", "rayon1", "rayon2", "rayon3", "rayon4", "silk1", "silk2"),
    *("wool1", "linen1"),
)
"""Every preset: nine fitted yarns and two estimated ones."""


def test_amplitude_is_exact() -> None:
    turns = np.linspace(-0.5, 0.5, 101)
    radius = migration_radius(np.full(101, 0.8), turns, low=0.7, peak=np.full(101, 0.8))
    assert radius[50] == 0.8
    assert np.allclose(radius[[0, -1]], 0.7 * 0.8, rtol=1e-15)
    assert (np.diff(radius[:51]) > 0).all()


def test_periods_run_from_minimum_to_minimum() -> None:
    assert migration_period_index(np.array([-0.49, 0.0, 0.49, 0.51, 1.2])).tolist() == [0, 0, 0, 1, 1]


@pytest.mark.parametrize("preset", ALL)
def test_generated_fibers_migrate_with_the_set_period_and_amplitude(
    preset, fiber_config, straight_yarn
) -> None:
    """One untwisted ply in the middle of the yarn: a fiber's distance from the center is its radius."""
    config = fiber_config(
        preset, plies=1, scale="as_fitted", ply_center_radius_mm=0.0, ellipse_long_mm=0.1,
        ellipse_short_mm=0.1, fuzz=0.0, fibers_per_ply=20, fiber_count_scale=1.0,
        segment_mm=0.01, variation={},
    )  # fmt: skip
    period = abs(config.fiber_pitch_mm) / config.migration_per_turn
    fiber_set = run(config, straight_yarn(8 * period, 0.1))
    curves = export_curves(fiber_set, FiberSelection())
    radius = np.linalg.norm(curves.points[:, 1:].reshape(curves.curve_count, -1, 2), axis=-1)
    own = fiber_set.seats["radius"][:, None] * 0.1
    samples = radius.shape[1]
    assert np.allclose(radius.max(axis=1, keepdims=True), own, rtol=2e-4)
    assert np.allclose(radius.min(axis=1, keepdims=True), config.migration_min * own, rtol=2e-4)
    s = np.linspace(0, 8, samples)
    turns = s + fiber_set.seats["migration_turns"][:, None]
    expected = own * (config.migration_min + (1 - config.migration_min) / 2 * (1 + np.cos(2 * np.pi * turns)))
    assert np.abs(radius - expected).max() < 1e-6
