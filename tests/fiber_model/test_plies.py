"""Zhao, Luan and Bala 2016, equations 2 and 4, and their scaling to a yarn."""

from __future__ import annotations

import numpy as np
import pytest

from weft.fiber_model.fiber_curves import export_curves, strand_points
from weft.fiber_model.fibers import run
from weft.fiber_model.plies import (
    fitted_outer_radius,
    phase_at_nodes,
    place_in_ply,
    scaled_plies,
    turns_along,
)

ALL = (
    *("cotton1", "cotton2", "polyester1", "rayon1", "rayon2", "rayon3", "rayon4", "silk1", "silk2"),
    *("wool1", "linen1"),
)
"""Every preset: nine fitted yarns and two estimated ones."""


def _cross_sections(fiber_set) -> np.ndarray:
    """Body fibers of a straight yarn along x as complex numbers, shape [fiber_count, node_count]."""
    curves = export_curves(fiber_set)
    points = curves.points[: curves.offsets[fiber_set.report.body_fiber_count]].astype(np.float64)
    frame = fiber_set.nodes[0]
    across = points @ frame["normal"] + 1j * (points @ frame["binormal"])
    return across.reshape(fiber_set.report.body_fiber_count, -1)


@pytest.mark.parametrize("preset", ALL)
def test_plies_turn_with_arc_length(preset, fiber_config, straight_yarn) -> None:
    """Untwisted fibers: the whole cross-section of all plies turns as one by 2 pi s / pitch."""
    config = fiber_config(preset, fiber_pitch_mm=0.0, fuzz=0.0, fiber_count_scale=1.0, variation={})
    fiber_set = run(config, straight_yarn(30.0))
    pitch = scaled_plies(config, 1.0).ply_pitch
    section = _cross_sections(fiber_set)
    angle = np.angle((section * section[:, :1].conj()).sum(axis=0))
    s = np.arange(section.shape[1]) * float(fiber_set.yarns["step"][0])
    s *= 30.0 / s[-1]
    error = np.angle(np.exp(1j * (angle - (2 * np.pi * s / pitch if pitch else 0))))
    assert np.abs(error).max() < 1e-6


def test_phases_stay_exact_over_a_hundred_meters(fiber_config, straight_yarn) -> None:
    config = fiber_config(
        "silk1", fiber_pitch_mm=0.0, fuzz=0.0, segment_mm=0.5, scale="as_fitted", fibers_per_ply=4
    )
    fiber_set = run(config, straight_yarn(100_000.0, 0.2))
    last = fiber_set.stretch_count - 1
    body = config.plies * config.fibers_per_ply
    first, end = (strand_points(fiber_set, np.array([j])).points.reshape(body, -1, 3) for j in (0, last))
    frame = fiber_set.nodes[0]
    turned = [
        p.astype(np.float64) @ frame["normal"] + 1j * (p.astype(np.float64) @ frame["binormal"])
        for p in (first[:, 0], end[:, -1])
    ]
    angle = np.angle((turned[1] * turned[0].conj()).sum())
    length = float(fiber_set.report.yarn_length_mm)
    assert abs(np.angle(np.exp(1j * (angle - 2 * np.pi * (length / config.ply_pitch_mm % 1))))) < 1e-6


def test_positive_pitch_is_right_handed(fiber_config, straight_yarn) -> None:
    """Seen from the end, a point that comes nearer turns counterclockwise."""
    config = fiber_config("cotton1", ply_pitch_mm=5.0, fiber_pitch_mm=0.0, fuzz=0.0)
    fiber_set = run(config, straight_yarn(4.0))
    points = export_curves(fiber_set).points[:2].astype(np.float64)
    assert points[0, 1] * points[1, 2] - points[0, 2] * points[1, 1] > 0


def test_short_axis_points_to_the_yarn_center(fiber_config) -> None:
    shape = scaled_plies(fiber_config("cotton2", scale="as_fitted"), 1.0)
    for turns in (0.0, 0.3, 0.77):
        outward = np.array([np.cos(2 * np.pi * turns), np.sin(2 * np.pi * turns)])
        center, top, side = (
            place_in_ply(np.array(x), np.array(y), np.array(turns), shape)
            for x, y in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))
        )
        assert np.allclose(center, shape.center_radius * outward)
        assert np.allclose(top - center, shape.short * outward)
        assert np.linalg.norm(side - center) == pytest.approx(shape.long)
        assert (side - center) @ outward == pytest.approx(0, abs=1e-12)


def test_as_fitted_keeps_the_preset(fiber_config) -> None:
    config = fiber_config("rayon1", scale="as_fitted")
    shape = scaled_plies(config, 5.0)
    assert (shape.long, shape.short) == (config.ellipse_long_mm, config.ellipse_short_mm)
    assert (shape.center_radius, shape.ply_pitch) == (config.ply_center_radius_mm, config.ply_pitch_mm)
    assert shape.fibers_per_ply == config.fibers_per_ply


@pytest.mark.parametrize("separation", ["as_fitted", "apart"])
def test_fit_radius_touches_the_yarn_and_keeps_the_packing(fiber_config, separation) -> None:
    config = fiber_config("cotton2", ply_separation=separation)
    shape = scaled_plies(config, 1.0)
    assert shape.center_radius + shape.short == pytest.approx(1.0)
    packing = config.fibers_per_ply / (config.ellipse_long_mm * config.ellipse_short_mm)
    assert shape.fibers_per_ply / (shape.long * shape.short) == pytest.approx(packing, rel=2e-3)
    assert shape.scale == pytest.approx(1 / fitted_outer_radius(config))
    if separation == "apart":
        assert shape.center_radius > shape.short


def test_closed_yarns_turn_a_whole_number_of_times() -> None:
    assert turns_along(10.0, 3.0, closed=True) == 3.0
    assert turns_along(10.0, -3.0, closed=True) == -3.0
    assert turns_along(10.0, 4.0, closed=False) == 2.5
    assert turns_along(10.0, 0.0, closed=True) == 0.0
    phase = phase_at_nodes(-7.0, 1000)
    assert phase[-1] == phase[0] == 0.0
    assert phase[1] == pytest.approx(1 - 0.007, abs=1e-15)
