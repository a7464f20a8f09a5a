"""FiberSet as a whole: closing, bounds, lengths, reports, and what it refuses."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from weft.fiber_model.fiber_curves import export_curves, strand_points
from weft.fiber_model.fibers import run
from weft.fiber_model.plies import scaled_plies
from weft.fiber_model.yarns.yarns import YarnSet
from weft.files.errors import InputError


def _two_types(yarns: YarnSet) -> YarnSet:
    kinds = np.arange(len(yarns.radius), dtype=np.int32) % 2
    return dataclasses.replace(yarns, yarn_type=kinds, type_names=("warp", "weft"))


def test_closed_yarns_close(fiber_config, yarn_loop) -> None:
    """Every fiber ends where it began, in the direction in which it began."""
    fiber_set = run(fiber_config("cotton2", fiber_count_scale=1.0, fuzz=4.0), yarn_loop(7.3))
    curves = export_curves(fiber_set)
    body = curves.ply >= 0
    first, last = curves.offsets[:-1][body], curves.offsets[1:][body] - 1
    p = curves.points.astype(np.float64)
    assert np.linalg.norm(p[first] - p[last], axis=1).max() < 1e-3 * 1.0
    turn = (p[first + 1] - p[first]) - (p[last] - p[last - 1])
    usual = (p[first + 2] - p[first + 1]) - (p[first + 1] - p[first])
    assert np.linalg.norm(turn, axis=1).max() < 2 * np.linalg.norm(usual, axis=1).max()


def test_bounds_hold_every_point(fiber_config, yarn_loop) -> None:
    fiber_set = run(fiber_config("rayon3", fuzz=4.0, fiber_count_scale=1.0, perturbation=0.3), yarn_loop(6.0))
    bounds = fiber_set.stretch_bounds()
    made = strand_points(fiber_set, np.arange(fiber_set.stretch_count))
    assert bounds.dtype == np.float32
    assert bounds.shape == (fiber_set.stretch_count, 2, 3)
    for stretch in range(fiber_set.stretch_count):
        points = made.points[made.offsets[stretch] : made.offsets[stretch + 1]]
        assert (points >= bounds[stretch, 0]).all()
        assert (points <= bounds[stretch, 1]).all()
        assert (bounds[stretch, 1] - bounds[stretch, 0]).max() < 3 * np.ptp(points, axis=0).max()


def test_bounds_hold_the_tallest_loops(fiber_config, straight_yarn) -> None:
    """Loops alone, wide enough that nothing else gives them room."""
    values = {"hair_density_per_mm": 0.0, "loop_radius_sd_mm": 0.2, "loop_density_per_mm": 30.0}
    fiber_set = run(fiber_config("cotton1", scale="as_fitted", **values), straight_yarn(20.0, 0.2))
    points = export_curves(fiber_set).points
    bounds = fiber_set.stretch_bounds()
    assert (points.min(axis=0) >= bounds[:, 0].min(axis=0)).all()
    assert (points.max(axis=0) <= bounds[:, 1].max(axis=0)).all()


def test_generated_length_is_the_sum_of_all_segments(fiber_config, straight_yarn) -> None:
    fiber_set = run(fiber_config("cotton1", fuzz=2.0), straight_yarn(10.0, count=2))
    lengths = fiber_set.fiber_lengths_mm()
    curves = export_curves(fiber_set)
    steps = np.linalg.norm(np.diff(curves.points.astype(np.float64), axis=0), axis=1)
    steps[curves.offsets[1:-1] - 1] = 0
    assert lengths.sum() == pytest.approx(steps.sum(), rel=1e-12)


def test_generated_length_of_straight_fibers_is_exact(fiber_config, straight_yarn) -> None:
    values = {"ply_pitch_mm": 0.0, "fiber_pitch_mm": 0.0, "migration_per_turn": 0.0, "fuzz": 0.0}
    fiber_set = run(fiber_config("cotton1", **values), straight_yarn(10.0))
    expected = fiber_set.report.body_fiber_count * 10.0
    assert fiber_set.fiber_lengths_mm()[:, 0].sum() == pytest.approx(expected, rel=1e-6)
    assert fiber_set.report.body_fiber_length_mm == pytest.approx(expected)


def test_a_helix_has_the_length_of_a_helix(fiber_config, straight_yarn) -> None:
    """One ply, no migration: each fiber of radius R runs sqrt(1 + (2 pi R / pitch)^2) per length of yarn."""
    config = fiber_config(
        "cotton1",
        plies=1,
        ply_center_radius_mm=0.0,
        ellipse_long_mm=0.1,
        ellipse_short_mm=0.1,
        fuzz=0.0,
        migration_per_turn=0.0,
        scale="as_fitted",
        segment_mm=0.01,
        migration_min=1.0,
    )
    fiber_set = run(config, straight_yarn(20.0, 0.1))
    slope = (
        2 * np.pi * 0.1 * fiber_set.seats["radius"] * (1 / config.fiber_pitch_mm + 1 / config.ply_pitch_mm)
    )
    expected = 20.0 * np.sqrt(1 + slope.astype(np.float64) ** 2).sum()
    assert fiber_set.fiber_lengths_mm().sum() == pytest.approx(expected, rel=1e-5)


def test_segments_follow_the_helix(fiber_config, straight_yarn) -> None:
    """Halfway between nodes the true fiber, made with twice as many nodes, is within the set sagitta."""
    config = fiber_config("cotton2", fuzz=0.0, fiber_count_scale=1.0)
    coarse = run(config, straight_yarn(10.0))
    step = coarse.report.segment_mm
    fine = run(config.model_copy(update={"segment_mm": step / 2 * (1 + 1e-9)}), straight_yarn(10.0))
    a, b = (export_curves(s) for s in (coarse, fine))
    body = coarse.report.body_fiber_count
    points, truth = a.points.reshape(body, -1, 3), b.points.reshape(body, -1, 3)
    assert np.abs(points - truth[:, ::2]).max() < 1e-5
    middle = 0.5 * (points[:, 1:] + points[:, :-1])
    sagitta = np.linalg.norm(middle - truth[:, 1::2], axis=-1)
    assert np.percentile(sagitta, 95) < config.sagitta_in_fiber_radii * config.fiber_radius_mm


def test_tight_bends_do_not_fold_over(fiber_config, yarn_loop) -> None:
    """A yarn of radius 1 bent to a radius of 0.8: every fiber still runs forward, and it is counted."""
    config = fiber_config("cotton2", fuzz=0.0, fiber_count_scale=1.0, ply_pitch_mm=0.0, fiber_pitch_mm=0.0)
    fiber_set = run(config, yarn_loop(0.8, wave=0.0))
    assert fiber_set.report.folded_node_count > 0.9 * fiber_set.report.node_count
    assert any("bends tighter" in warning for warning in fiber_set.report.warnings)
    body = fiber_set.report.body_fiber_count
    points = export_curves(fiber_set).points.reshape(body, -1, 3).astype(np.float64)
    step = np.diff(points, axis=1)
    node = fiber_set.nodes[: points.shape[1]]
    tangent = np.cross(node["normal"], node["binormal"]).astype(np.float64)
    assert ((step * (tangent[1:] + tangent[:-1])).sum(axis=-1) > 0).all()
    gentle = run(config, yarn_loop(8.0, wave=0.0))
    assert gentle.report.folded_node_count == 0
    assert gentle.report.warnings == ()


@pytest.mark.parametrize("values", [{}, {"cords": 2}, {"ply_separation": "as_fitted"}])
def test_folds_are_counted_where_radius_times_curvature_passes_1(values, fiber_config, yarn_loop) -> None:
    """Loops of radius 2, flat: the count changes from none to all as the yarn's radius passes theirs."""
    counts = [
        run(
            fiber_config("cotton1", fiber_count_scale=0.01, **values), yarn_loop(2.0, radius, wave=0.0)
        ).report
        for radius in (1.98, 2.02)
    ]
    assert counts[0].folded_node_count == 0
    assert counts[1].folded_node_count == counts[1].node_count
    assert f"at {counts[1].node_count} nodes the yarn bends tighter" in counts[1].warnings[0]


def test_thick_places_fold_where_the_yarn_would_not(fiber_config, yarn_loop) -> None:
    """Counted node by node, and squeezed like all folds: no fiber passes the center of curvature."""
    variation = {"thickness_sd": 0.3, "thickness_length_mm": 3.0, "thick_places": "looser"}
    config = fiber_config("cotton1", fiber_count_scale=0.1, variation=variation, fuzz=0.0)
    fiber_set = run(config, yarn_loop(2.0, 1.5, wave=0.0))
    tight = fiber_set.details["thickness"] * 1.5 > 2.0
    assert 0.05 < tight.mean() < 0.6
    assert abs(fiber_set.report.folded_node_count - tight.sum()) <= 0.01 * len(tight)
    points = export_curves(fiber_set).points.reshape(fiber_set.report.body_fiber_count, -1, 3)
    inward = -fiber_set.nodes["position"] / np.linalg.norm(fiber_set.nodes["position"], axis=1)[:, None]
    assert ((points - fiber_set.nodes["position"]) * inward).sum(axis=-1).max() < 0.951 * 2.0


@pytest.mark.parametrize(("ratio", "warned"), [(0.5, True), (0.75, False), (1.25, False), (5.0, True)])
def test_warns_when_yarn_and_preset_differ_in_radius(ratio, warned, fiber_config, straight_yarn) -> None:
    config = fiber_config("cotton2", scale="as_fitted")
    outer = config.ply_center_radius_mm + config.ellipse_short_mm
    report = run(config, straight_yarn(3.0, ratio * outer)).report
    assert report.radius_ratio == pytest.approx((ratio, ratio))
    assert any("times the radius" in warning for warning in report.warnings) is warned
    fitted = run(config.model_copy(update={"scale": "fit_radius"}), straight_yarn(3.0, ratio * outer)).report
    assert fitted.warnings == ()


def test_yarn_types_have_their_own_values(fiber_config, straight_yarn) -> None:
    yarns = _two_types(straight_yarn(6.0, count=4))
    config = fiber_config("cotton2", by_type={"weft": {"fiber_radius_mm": 0.02, "plies": 2}})
    fiber_set = run(config, yarns)
    assert fiber_set.type_names == ("warp", "weft")
    assert fiber_set.fiber_radius_mm == (0.008, 0.02)
    assert fiber_set.yarns["plies"].tolist() == [3, 2, 3, 2]
    kinds = fiber_set.stretch_type()
    assert kinds.dtype == np.int32
    assert (kinds == fiber_set.stretches["yarn"] % 2).all()
    body = [
        config.for_type(n).plies * scaled_plies(config.for_type(n), 1.0).fibers_per_ply
        for n in yarns.type_names
    ]
    counts = fiber_set.stretch_strand_counts()
    assert (counts - fiber_set.stretches["hairs"] == np.array(body)[kinds]).all()


def test_refuses_an_unknown_yarn_type(fiber_config, straight_yarn) -> None:
    config = fiber_config("cotton2", by_type={"wefd": {"plies": 2}})
    with pytest.raises(InputError, match=r"by_type.wefd: no such yarn type; .*Did you mean 'weft'"):
        run(config, _two_types(straight_yarn(6.0, count=2)))


def test_refuses_more_nodes_than_fit(fiber_config, straight_yarn) -> None:
    with pytest.raises(InputError, match=r"Raise fibers.segment_mm"):
        run(fiber_config("cotton2", segment_mm=1e-6), straight_yarn(1000.0))


def test_refuses_more_fibers_than_fit(fiber_config, straight_yarn) -> None:
    with pytest.raises(InputError, match=r"Lower fibers.fiber_count_scale"):
        run(fiber_config("cotton2", fiber_count_scale=10_000, fibers_per_ply=90_000), straight_yarn(10.0))


def test_refuses_no_yarns(fiber_config, straight_yarn) -> None:
    with pytest.raises(InputError, match="there are no yarns"):
        run(fiber_config("cotton2"), straight_yarn(10.0, count=0))
