"""Plies of plies: cords around the yarn's center, plies around the cord's."""

from __future__ import annotations

import numpy as np
import pytest

from weft.fiber_model.fiber_curves import export_curves, strand_points
from weft.fiber_model.fibers import run
from weft.fiber_model.plies import cord_radius_share, fitted_outer_radius, scaled_plies


def _sections(fiber_set) -> np.ndarray:
    """Body fibers of a straight yarn along x as complex numbers, shape [ply_count, fibers, node_count]."""
    curves = export_curves(fiber_set)
    points = curves.points[: curves.offsets[fiber_set.report.body_fiber_count]].astype(np.float64)
    frame = fiber_set.nodes[0]
    across = points @ frame["normal"] + 1j * (points @ frame["binormal"])
    return across.reshape(int(fiber_set.yarns["plies"][0]), int(fiber_set.yarns["fibers_per_ply"][0]), -1)


@pytest.mark.parametrize(("cords", "plies"), [(2, 3), (3, 2), (4, 1)])
def test_ply_centers_lie_where_the_formula_says(cords, plies, fiber_config, straight_yarn) -> None:
    """Fibers at radius 0 are the ply's center, R_cord e^(i C) + R_ply e^(i (C + P)); angles within 1e-6."""
    config = fiber_config(
        "cotton1", cords=cords, plies=plies, cord_pitch_mm=11.0, fuzz=0.0, segment_mm=0.1, seed=3
    )
    yarns = straight_yarn(40.0)
    fiber_set = run(config, yarns)
    fiber_set.seats["radius"] = 0.0
    center = _sections(fiber_set)[:, 0]
    shape = scaled_plies(config, 1.0)
    s = np.linspace(0, 40.0, center.shape[1])
    begin_cord, begin_ply = (
        complex(*fiber_set.details["cord"][0]),
        complex(*fiber_set.nodes["ply"][0]),
    )
    cord, ply = np.divmod(np.arange(cords * plies), plies)
    cord_turn = begin_cord * np.exp(2j * np.pi * (s / shape.cord_pitch + cord[:, None] / cords))
    ply_turn = begin_ply * np.exp(2j * np.pi * (s / shape.ply_pitch + ply[:, None] / plies))
    expected = cord_turn * (shape.cord_center_radius + shape.center_radius * ply_turn)
    assert np.abs(center - expected).max() < 1e-6
    centers = center.reshape(cords, plies, -1).mean(axis=1)
    if plies > 1:
        turned = centers / centers[:, :1]
        error = np.angle(turned * np.exp(-2j * np.pi * s / shape.cord_pitch))
        assert np.abs(error).max() < 1e-6
        around = (center.reshape(cords, plies, -1) - centers[:, None]) / (centers / np.abs(centers))[:, None]
        error = np.angle(around / around[..., :1] * np.exp(-2j * np.pi * s / shape.ply_pitch))
        assert np.abs(error).max() < 1e-6


def test_fibers_stay_in_their_ply_and_the_plies_in_the_yarn(fiber_config, straight_yarn) -> None:
    config = fiber_config("rayon2", cords=2, plies=3, fuzz=0.0, fiber_count_scale=1.0)
    fiber_set = run(config, straight_yarn(30.0))
    section = _sections(fiber_set)
    assert (
        np.abs(section).max() <= 1.0 + 0.15
    )  # long axes of ellipses, beyond the circle that touches the short
    radii = fiber_set.seats["radius"].copy()
    fiber_set.seats["radius"] = 0.0
    center = _sections(fiber_set)[:, :1]
    shape = scaled_plies(config, 1.0)
    assert np.abs(section - center).max() <= max(shape.long, shape.short) * radii.max() * (1 + 1e-5)


def test_a_yarn_of_one_cord_is_the_yarn_itself(fiber_config, straight_yarn) -> None:
    one, plain = (
        run(fiber_config("cotton2", fiber_count_scale=1.0, **v), straight_yarn(5.0))
        for v in ({"cords": 1, "cord_pitch_mm": 7.0}, {})
    )
    first, second = (strand_points(s, np.arange(s.stretch_count)).points for s in (one, plain))
    assert (first.view(np.uint32) == second.view(np.uint32)).all()


@pytest.mark.parametrize("cords", [2, 3, 5])
def test_cords_touch_each_other_and_the_yarns_radius(cords, fiber_config) -> None:
    shape = scaled_plies(fiber_config("cotton1", cords=cords), 1.0)
    own = cord_radius_share(cords)
    assert shape.cord_center_radius + own == pytest.approx(1.0)
    assert shape.cord_center_radius * np.sin(np.pi / cords) == pytest.approx(own)
    assert shape.center_radius + shape.short == pytest.approx(own)
    fitted = fiber_config("cotton1", cords=cords, scale="as_fitted")
    outer = scaled_plies(fitted, 1.0)
    assert outer.cord_center_radius + outer.center_radius + outer.short == pytest.approx(
        fitted_outer_radius(fitted)
    )


def test_cords_turn_against_their_plies_unless_told(fiber_config) -> None:
    shape = scaled_plies(fiber_config("cotton1", cords=2), 1.0)
    assert shape.cord_pitch == pytest.approx(-2 * shape.ply_pitch)
    assert scaled_plies(fiber_config("cotton1", cords=2, cord_pitch_mm=4.0), 1.0).cord_pitch == 4.0


def test_closed_cabled_yarns_meet_at_both_levels(fiber_config, yarn_loop) -> None:
    config = fiber_config("cotton1", cords=2, fiber_count_scale=0.3, fuzz=3.0)
    fiber_set = run(config, yarn_loop(7.3))
    curves = export_curves(fiber_set)
    body = curves.ply >= 0
    first, last = curves.offsets[:-1][body], curves.offsets[1:][body] - 1
    assert (curves.points[first] == curves.points[last]).all()
    p = curves.points.astype(np.float64)
    turn = (p[first + 1] - p[first]) - (p[last] - p[last - 1])
    usual = (p[first + 2] - p[first + 1]) - (p[first + 1] - p[first])
    assert np.linalg.norm(turn, axis=1).max() < 2 * np.linalg.norm(usual, axis=1).max()


@pytest.mark.parametrize("fuzz", [0.0, 2.0])
def test_bounds_hold_a_cabled_yarn(fuzz, fiber_config, yarn_loop) -> None:
    config = fiber_config("rayon3", cords=3, plies=2, fuzz=fuzz, fiber_count_scale=1.0)
    fiber_set = run(config, yarn_loop(6.0))
    made = strand_points(fiber_set, np.arange(fiber_set.stretch_count))
    bounds = fiber_set.stretch_bounds()
    for stretch in range(fiber_set.stretch_count):
        points = made.points[made.offsets[stretch] : made.offsets[stretch + 1]]
        assert (points >= bounds[stretch, 0]).all()
        assert (points <= bounds[stretch, 1]).all()


def test_segments_follow_the_cabled_helix(fiber_config, straight_yarn) -> None:
    """Cords wound tightly, plies and fibers hardly, so that the cords decide the length of segments."""
    config = fiber_config(
        "cotton2", fuzz=0.0, cords=2, cord_pitch_mm=2.5, ply_pitch_mm=1e3, fiber_pitch_mm=1e3,
        fiber_count_scale=0.2,
    )  # fmt: skip
    coarse = run(config, straight_yarn(10.0))
    step = coarse.report.segment_mm
    fine = run(config.model_copy(update={"segment_mm": step / 2 * (1 + 1e-9)}), straight_yarn(10.0))
    body = coarse.report.body_fiber_count
    points, truth = (export_curves(s).points.reshape(body, -1, 3) for s in (coarse, fine))
    middle = 0.5 * (points[:, 1:] + points[:, :-1])
    sagitta = np.linalg.norm(middle - truth[:, 1::2], axis=-1)
    assert np.percentile(sagitta, 95) < config.sagitta_in_fiber_radii * config.fiber_radius_mm
