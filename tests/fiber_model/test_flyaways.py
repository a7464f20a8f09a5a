"""Zhao, Luan and Bala 2016, section 3.2 and equation 11."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from weft.fiber_model.fiber_arrays import plan_yarn
from weft.fiber_model.fiber_curves import export_curves
from weft.fiber_model.fibers import run
from weft.fiber_model.flyaways import is_loop, loop_peak, sample_hairs

COUNT = 50_000
ALL = (
    *("cotton1", "cotton2", "polyester1", "rayon1", "rayon2", "rayon3", "rayon4", "silk1", "silk2"),
    *("wool1", "linen1"),
)
"""Every preset: nine fitted yarns and two estimated ones."""


def _plan(config, length=1000.0, radius=0.2):
    return plan_yarn(config, radius, length, round(length / 0.1), closed=False)


def _size(config) -> float:
    """Millimeters per unit of distance from the ply center."""
    return float(np.sqrt(config.ellipse_long_mm * config.ellipse_short_mm))


def _matches(sample, mean, sd) -> bool:
    """Mean within 4 standard errors, standard deviation within 2 percent."""
    return abs(sample.mean() - mean) < 4 * sd / np.sqrt(len(sample)) and abs(sample.std() / sd - 1) < 0.02


@pytest.mark.parametrize("preset", ALL)
def test_hairs_and_loops_are_as_many_as_asked_for(preset, fiber_config, straight_yarn) -> None:
    """Within 3 sqrt(rho L); of silk1, which asks for more loops than periods, every period is one."""
    config = fiber_config(preset, scale="as_fitted", segment_mm=0.1, variation={})
    length = 60.0
    fiber_set = run(config, straight_yarn(length, 0.2, count=2))
    plies = 2 * config.plies
    hairs = plies * config.hair_density_per_mm * length
    assert abs(fiber_set.report.hair_count - hairs) < 3 * np.sqrt(hairs)
    curves = export_curves(fiber_set)
    period = abs(config.fiber_pitch_mm) / config.migration_per_turn
    node = np.arange(fiber_set.yarns["intervals"][0] + 1) * length / fiber_set.yarns["intervals"][0]
    index = np.floor(node / period + fiber_set.seats["migration_turns"][:, None] + 0.5).astype(int)
    body = np.flatnonzero(curves.ply >= 0)
    kinds = [curves.kind[curves.offsets[i] : curves.offsets[i + 1]] for i in body]
    found = sum(len(np.unique(index[fiber][kind == 1])) for fiber, kind in enumerate(kinds))
    # periods cut by the yarn's ends are counted whole: half a period at each end of each fiber, on average
    periods = plies * config.fibers_per_ply * (length + period) / period
    asked = min(plies * config.loop_density_per_mm * (length + period), periods)
    assert len(kinds) == fiber_set.report.body_fiber_count
    assert abs(found - asked) < 3 * np.sqrt(asked)


def test_silk1_has_fewer_periods_than_loops_and_says_so(fiber_config, straight_yarn) -> None:
    fiber_set = run(fiber_config("silk1", scale="as_fitted"), straight_yarn(20.0, 0.2))
    assert fiber_set.report.loop_demand > 2
    assert any("loops are made" in warning for warning in fiber_set.report.warnings)


@pytest.mark.parametrize("preset", ALL)
@pytest.mark.parametrize("factor", [0.5, 1.0])
def test_loop_radii_follow_their_normal(preset, fiber_config, factor) -> None:
    config = fiber_config(preset, flyaway_sd_factor=factor)
    radius = _plan(config).flyaways.loop_radius
    peak = loop_peak(3, 0, np.arange(COUNT), 5, np.full(COUNT, 0.1), radius) * _size(config)
    mean, sd = config.loop_radius_mm, factor * config.loop_radius_sd_mm
    above_own = stats.truncnorm((0.1 * _size(config) - mean) / sd, np.inf, mean, sd)
    assert _matches(peak, above_own.mean(), above_own.std())


def test_loops_rise_above_their_own_fiber(fiber_config) -> None:
    radius = _plan(fiber_config("rayon1")).flyaways.loop_radius
    own = np.linspace(0, 1, COUNT)
    peak = loop_peak(3, 0, np.arange(COUNT), 5, own, radius)
    truncated = stats.truncnorm((own[-1] - radius[0]) / radius[1], np.inf, *radius)
    assert (peak > own.astype(np.float32)).mean() > 0.999
    assert peak[-2000:].mean() == pytest.approx(truncated.mean(), abs=4 * truncated.std() / np.sqrt(2000))


@pytest.mark.parametrize("preset", ALL)
@pytest.mark.parametrize("factor", [0.5, 1.0])
def test_hair_shapes_follow_their_normals(preset, fiber_config, factor) -> None:
    config = fiber_config(preset, scale="as_fitted", flyaway_sd_factor=factor, hair_root_inside=False)
    hair = np.arange(COUNT)
    hairs = sample_hairs(9, 4, hair // 50, hair % 50, config.plies, _plan(config).flyaways)
    for values, mean, sd in (
        (hairs.radius * _size(config), config.hair_radius_mm, config.hair_radius_sd_mm),
        (hairs.radius_span * _size(config), config.hair_radius_span_mm, config.hair_radius_span_sd_mm),
    ):
        above_zero = stats.truncnorm(-mean / (factor * sd), np.inf, mean, factor * sd)
        assert _matches(values, above_zero.mean(), above_zero.std())
    assert _matches(hairs.z_span, config.hair_z_span_mm, factor * config.hair_z_span_sd_mm)
    angle = np.degrees(hairs.angle_span)
    assert _matches(angle, config.hair_angle_span_deg, factor * config.hair_angle_span_sd_deg)
    assert stats.kstest(hairs.angle, "uniform").pvalue > 1e-4
    assert stats.kstest(hairs.start, "uniform").pvalue > 1e-4
    assert np.abs(np.bincount(hairs.ply) / COUNT - 1 / config.plies).max() < 0.01


def test_hairs_begin_inside_their_ply(fiber_config) -> None:
    config = fiber_config("cotton1")
    hair = np.arange(COUNT)
    hairs = sample_hairs(9, 4, hair // 50, hair % 50, config.plies, _plan(config).flyaways)
    assert hairs.radius.max() == 1
    assert (hairs.radius < 1).mean() > 0.5


def test_fuzz_scales_number_and_length(fiber_config) -> None:
    """One factor for both; a loop's length is what it stands off the border of its ply."""
    plain, fuzzy = (_plan(fiber_config("cotton2", fuzz=f)).flyaways for f in (1.0, 3.0))
    assert fuzzy.hair_density == pytest.approx(3 * plain.hair_density)
    assert fuzzy.loop_demand == pytest.approx(3 * plain.loop_demand)
    for name in ("hair_z_span", "hair_radius_span"):
        assert getattr(fuzzy, name) == pytest.approx([3 * v for v in getattr(plain, name)])
    assert fuzzy.loop_radius[0] - 1 == pytest.approx(3 * (plain.loop_radius[0] - 1))
    assert fuzzy.loop_radius[1] == pytest.approx(3 * plain.loop_radius[1])
    assert fuzzy.hair_radius == plain.hair_radius


def test_the_length_can_be_kept_from_following_fuzz(fiber_config) -> None:
    plain, many = (
        _plan(fiber_config("cotton2", **v)).flyaways for v in ({}, {"fuzz": 3.0, "fuzz_length": 1})
    )
    assert many.hair_density == pytest.approx(3 * plain.hair_density)
    for name in ("hair_z_span", "hair_radius_span", "loop_radius"):
        assert getattr(many, name) == getattr(plain, name)


def test_fuzz_of_zero_leaves_no_flyaway(fiber_config, straight_yarn) -> None:
    curves = export_curves(run(fiber_config("cotton2", fuzz=0.0), straight_yarn(10.0)))
    assert (curves.kind == 0).all()


def test_no_fuzz_is_no_fuzz() -> None:
    assert not is_loop(1, 2, np.arange(10_000), 3, 0.0).any()
    assert is_loop(1, 2, np.arange(10_000), 3, 1.0).all()
