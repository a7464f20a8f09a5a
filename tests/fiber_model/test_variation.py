"""Thickness and color along a yarn: what is asked for, and the same wherever it is asked."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from weft.fiber_model.config import VariationConfig
from weft.fiber_model.counter_random import seed_key
from weft.fiber_model.fiber_curves import FiberSelection, export_curves, strand_points
from weft.fiber_model.fibers import run
from weft.fiber_model.variation import YarnPlace, draw_slubs, lightness, smooth_normal, thickness

OPEN = YarnPlace(yarn=2, length=400_000.0, closed=False)
SEED = seed_key(5)
SLUBBY = {"slubs_per_m": 60.0, "slub_length_mm": 12.0, "slub_length_sd_mm": 3.0, "slub_thickness": 2.5}
VARIED = {"thickness_sd": 0.15, "thickness_length_mm": 3.0, "color_sd": 0.1, "color_length_mm": 4.0, **SLUBBY}


def test_noise_is_a_standard_normal_with_the_set_correlation() -> None:
    """Samples 5 correlation lengths apart are independent: the bounds are 4 standard errors (1 in 16,000)."""
    length_mm = 3.0
    apart = np.arange(0, OPEN.length, 5 * length_mm)
    base = smooth_normal(SEED, OPEN, apart, length_mm)
    count = len(base)
    assert abs(base.mean()) < 4 / np.sqrt(count)
    assert abs(base.var() - 1) < 4 * np.sqrt(2 / count)
    assert stats.kstest(base, "norm").pvalue > 1e-4
    for distance in (0.25, 0.5, 1.0, 1.5):
        other = smooth_normal(SEED, OPEN, apart + distance * length_mm, length_mm)
        expected = np.exp(-(distance**2))
        assert abs((base * other).mean() - expected) < 4 * np.sqrt((1 + expected**2) / count)


@pytest.mark.parametrize("at", [0.0, 0.13, 0.5])
def test_the_noise_is_as_strong_at_every_place_of_a_short_loop(at: float) -> None:
    """Also where the window goes around several times: 2000 loops of each length, 4 standard errors."""
    for length in (1.0, 6.0, 40.0):
        values = [
            smooth_normal(SEED, YarnPlace(yarn, length, True), np.array([at * length]), 8.0)[0]
            for yarn in range(2000)
        ]
        assert abs(np.var(values) - 1) < 4 * np.sqrt(2 / len(values))


def test_thickness_has_the_set_mean_and_deviation() -> None:
    config = VariationConfig(thickness_sd=0.2, thickness_length_mm=5.0, color_sd=0.3, color_length_mm=5.0)
    s = np.arange(0, OPEN.length, 30.0)
    for values, sd in ((thickness(SEED, OPEN, s, config), 0.2), (lightness(SEED, OPEN, s, config), 0.3)):
        assert abs(values.mean() - 1) < 4 * sd / np.sqrt(len(s))
        kurtosis = stats.kurtosis(values) + 3
        assert abs(values.var() / sd**2 - 1) < 4 * np.sqrt((kurtosis - 1) / len(s))
        assert values.min() > 0
    both = np.corrcoef(thickness(SEED, OPEN, s, config), lightness(SEED, OPEN, s, config))[0, 1]
    assert abs(both) < 4 / np.sqrt(len(s))


@pytest.mark.parametrize("closed", [False, True])
def test_slubs_are_as_many_long_and_thick_as_asked_for(closed: bool) -> None:
    config = VariationConfig(slubs_per_m=25.0, slub_thickness=2.5)
    place = YarnPlace(3, 400_000.0, closed)
    slubs = draw_slubs(SEED, place, config)
    inside = (slubs.center >= 0) & (slubs.center < place.length)
    expected = 25.0 * 400.0
    assert abs(inside.sum() - expected) < 3 * np.sqrt(expected)
    for values, mean, sd in ((2 * slubs.half_length, 40.0, 10.0), (1 + slubs.added, 2.5, 0.3)):
        assert abs(values.mean() - mean) < 4 * sd / np.sqrt(len(values))
        assert abs(values.std() / sd - 1) < 0.03
    gaps = np.diff(np.sort(slubs.center[inside])) * 25e-3
    assert stats.kstest(gaps, "expon").pvalue > 1e-4


def test_slubs_are_as_many_at_the_ends_of_an_open_yarn() -> None:
    """Mean of what they add there over 1500 yarns: rate x length / 2 x peak, within 4 standard errors."""
    config = VariationConfig(slubs_per_m=25.0, slub_thickness=2.5)
    for at in (0.0, 100.0):
        places = [YarnPlace(yarn, 100.0, False) for yarn in range(1500)]
        added = np.array([thickness(SEED, place, np.array([at]), config)[0] - 1 for place in places])
        assert abs(added.mean() - 25e-3 * 20.0 * 1.5) < 4 * added.std() / np.sqrt(1500)


def test_a_slub_is_a_smooth_bump_of_its_thickness() -> None:
    config = VariationConfig(
        slubs_per_m=0.5, slub_length_sd_mm=0.0, slub_thickness_sd=0.0, slub_thickness=3.0
    )
    place = YarnPlace(0, 20_000.0, False)
    slubs = draw_slubs(SEED, place, config)
    alone = np.flatnonzero(np.diff(slubs.center, prepend=-1e9, append=1e9)[:-1] > 50)
    center = slubs.center[alone[1]]
    s = center + np.array([-25.0, -20.0, -10.0, 0.0, 10.0, 20.0, 25.0])
    assert thickness(SEED, place, s, config) == pytest.approx([1, 1, 2, 3, 2, 1, 1])


@pytest.mark.parametrize("closed", [False, True])
def test_any_part_of_a_yarn_alone_has_the_same_bits(closed: bool) -> None:
    config, place = VariationConfig(**VARIED), YarnPlace(1, 300.0, closed)
    s = np.linspace(0, place.length, 5001)
    for what in (thickness, lightness):
        whole = what(SEED, place, s, config)
        for begin, end in ((0, 1), (17, 400), (2500, 2503), (4000, 5001)):
            assert (what(SEED, place, s[begin:end], config) == whole[begin:end]).all()


@pytest.mark.parametrize("length", [3.0, 20.0, 300.0])
def test_closed_yarns_meet(length: float) -> None:
    config, place = VariationConfig(**VARIED), YarnPlace(1, length, True)
    near = 1e-6 * length
    for what in (thickness, lightness):
        first, second, before, last = what(SEED, place, np.array([0, near, length - near, length]), config)
        assert last == pytest.approx(first, rel=1e-12)
        assert (before - first) == pytest.approx(first - second, rel=0.01)  # no kink


def test_open_yarns_do_not_change_when_they_grow() -> None:
    config, s = VariationConfig(**VARIED), np.linspace(0, 200, 999)
    short, long = (thickness(SEED, YarnPlace(1, length, False), s, config) for length in (200.0, 900.0))
    assert (short == long).all()


def test_a_yarn_is_as_thick_as_its_variation_says(fiber_config, straight_yarn) -> None:
    """Untwisted, without migration: each fiber's distance from the center follows the thickness."""
    values = {"fuzz": 0.0, "fiber_pitch_mm": 0.0, "ply_pitch_mm": 0.0, "migration_per_turn": 0.0}
    config = fiber_config("cotton1", variation={**VARIED, "thick_places": "looser"}, **values)
    fiber_set = run(config, straight_yarn(60.0, 0.2))
    points = export_curves(fiber_set).points.astype(np.float64)
    distance = np.linalg.norm(points[:, 1:], axis=1).reshape(fiber_set.report.body_fiber_count, -1)
    place = YarnPlace(0, 60.0, False)
    expected = thickness(seed_key(0), place, np.linspace(0, 60, distance.shape[1]), VariationConfig(**VARIED))
    assert expected.max() > 2
    assert distance / expected == pytest.approx(
        distance[:, :1] / expected[0] * np.ones_like(distance), rel=1e-4
    )


def test_thick_places_have_more_fibers_at_the_same_packing(fiber_config, straight_yarn) -> None:
    config = fiber_config("cotton1", variation=VARIED, fuzz=0.0)
    fiber_set = run(config, straight_yarn(60.0))
    records, square = fiber_set.stretches, fiber_set.details["thickness"].astype(np.float64) ** 2
    section = [square[r["first"] : r["first"] + r["segments"] + 1].mean() for r in records]
    plain = run(fiber_config("cotton1", fuzz=0.0), straight_yarn(60.0)).yarns["fibers_per_ply"][0]
    assert records["fibers_per_ply"] == pytest.approx(plain * np.array(section), abs=0.501)
    assert fiber_set.yarns["fibers_per_ply"][0] == records["fibers_per_ply"].max() > 3 * plain
    straight = 3 * (records["fibers_per_ply"] * records["segments"] * fiber_set.yarns["step"][0]).sum()
    assert fiber_set.report.body_fiber_length_mm == pytest.approx(straight, rel=1e-6)


def test_exported_fibers_of_a_varied_yarn_are_all_of_its_fiber(fiber_config, yarn_loop) -> None:
    fiber_set = run(fiber_config("cotton1", variation=VARIED, fiber_count_scale=1.0), yarn_loop(5.0, 0.3))
    curves = export_curves(fiber_set)
    steps = np.linalg.norm(np.diff(curves.points.astype(np.float64), axis=0), axis=1)
    steps[curves.offsets[1:-1] - 1] = 0
    assert fiber_set.fiber_lengths_mm().sum() == pytest.approx(steps.sum(), rel=1e-12)
    assert np.diff(curves.offsets).min() >= 2
    part = export_curves(fiber_set, FiberSelection(arc_length_mm=(7.0, 16.0)))
    assert 0 < len(part.points) < len(curves.points)


def test_stretches_of_a_varied_yarn_alone_have_the_same_bits_and_stay_in_their_box(
    fiber_config, yarn_loop
) -> None:
    config = fiber_config("cotton2", variation=VARIED, fiber_count_scale=1.0, fuzz=2.0)
    fiber_set = run(config, yarn_loop(6.0, 0.3))
    whole = strand_points(fiber_set, np.arange(fiber_set.stretch_count))
    bounds = fiber_set.stretch_bounds()
    for stretch in range(fiber_set.stretch_count):
        alone = strand_points(fiber_set, np.array([stretch]))
        part = slice(whole.offsets[stretch], whole.offsets[stretch + 1])
        assert (alone.points.view(np.uint32) == whole.points[part].view(np.uint32)).all()
        assert (alone.points >= bounds[stretch, 0]).all()
        assert (alone.points <= bounds[stretch, 1]).all()
        assert (bounds[stretch, 1] - bounds[stretch, 0]).max() < 4 * np.ptp(alone.points, axis=0).max()
