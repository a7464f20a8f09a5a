"""Knits from charts: loops drawn through loops from the right side, yarns that touch without intersecting."""

from functools import cache

import numpy as np
import pytest

from tests.fiber_model.yarns.distances import clearance, own_clearance
from weft.fiber_model.yarns.catmull_rom import yarn_lengths
from weft.fiber_model.yarns.fabrics.knit import POINTS_PER_STITCH
from weft.fiber_model.yarns.fabrics.knit_chart import (
    Gauge,
    cable_reach,
    chart_gauge,
    knit_chart_yarns,
    knit_repeat,
    loop_length,
    repeated_course,
)
from weft.fiber_model.yarns.fabrics.stitch_chart import NAMED_CHARTS, read_chart
from weft.fiber_model.yarns.frames import build_frames

FLAT = [name for name in NAMED_CHARTS if not name.startswith("cable")]
BLOCKS = ("k3 p3", "k3 p3", "p3 k3", "p3 k3")
CROSSED = ("k4", "k c2b k", "k4", "k4")


@cache
def repeat(chart, wale=None):
    """Courses of one repeat of loops 4 mm wide, with their gauge."""
    gauge = chart_gauge(chart, 4.0, wale, None, None)
    return knit_repeat(read_chart(chart), gauge), gauge


@cache
def cloth(chart):
    """A cloth of at least two repeats each way, but for the widest charts."""
    stitches = read_chart(chart)
    gauge = chart_gauge(chart, 4.0, None, None, None)
    size = (max(stitches.wales + 1, 4) * gauge.wale, max(stitches.courses + 2, 6) * gauge.course)
    return knit_chart_yarns(size, chart=chart, stitch_width_mm=4.0)


@pytest.mark.parametrize("chart", [*NAMED_CHARTS, BLOCKS, CROSSED])
def test_yarns_touch_without_intersecting(chart):
    """Centers keep 97 % of a diameter: the compression that the README states."""
    yarns = cloth(chart)
    assert clearance(yarns) > 0.97
    assert min(own_clearance(yarns, yarn) for yarn in range(1, yarns.yarn_count - 1)) > 0.97


@pytest.mark.parametrize("chart", [*NAMED_CHARTS, BLOCKS, CROSSED])
def test_bends_are_wider_than_the_yarn(chart):
    yarns = cloth(chart)
    assert build_frames(yarns).folded_count(yarns.radius) == 0


@pytest.mark.parametrize("chart", [*FLAT, BLOCKS])
def test_loops_hold_the_yarn_of_one_stitch(chart):
    yarns = cloth(chart)
    gauge = chart_gauge(chart, 4.0, None, None, None)
    stitches = (yarns.point_counts - 1) / POINTS_PER_STITCH
    assert yarn_lengths(yarns) / stitches == pytest.approx(
        np.full(yarns.yarn_count, loop_length(gauge)), rel=0.04
    )


def crossing_signs(upper, lower, wales):
    """For each stitch of `upper` where it passes before (+) or behind (-) that below, from left to right."""
    found = [[] for _ in range(wales)]
    steps = np.diff(lower, axis=0)
    for k in range(len(upper) - 1):
        p, d = upper[k], upper[k + 1] - upper[k]
        determinant = d[0] * steps[:, 1] - d[1] * steps[:, 0]
        apart = lower[:-1] - p
        with np.errstate(divide="ignore", invalid="ignore"):
            u = (apart[:, 0] * steps[:, 1] - apart[:, 1] * steps[:, 0]) / determinant
            v = (apart[:, 0] * d[1] - apart[:, 1] * d[0]) / determinant
        hits = np.flatnonzero((u >= 0) & (u < 1) & (v >= 0) & (v < 1))
        hits = hits[hits // POINTS_PER_STITCH == k // POINTS_PER_STITCH]
        for hit in hits[np.argsort(u[hits])]:
            z = p[2] + u[hit] * d[2] - lower[hit, 2] - v[hit] * steps[hit, 2]
            found[k // POINTS_PER_STITCH].append("+" if z > 0 else "-")
    return ["".join(signs) for signs in found]


@pytest.mark.parametrize("chart", [*FLAT, BLOCKS])
def test_loops_are_drawn_through_from_the_side_that_the_chart_says(chart):
    """A knit stitch comes from behind, through the loop below and before its head; a purl the other way.

    Ribs are not drawn in here, so that one sees every crossing from the front.
    """
    courses, gauge = repeat(chart, 4.2)
    stitches = read_chart(chart).at_least(2)
    wales = 2 * stitches.wales
    for course in range(1, stitches.courses + 1):
        upper = repeated_course(courses, gauge, course, wales)
        lower = repeated_course(courses, gauge, course - 1, wales)
        signs = crossing_signs(upper, lower, wales)
        row = np.tile(stitches.knit[course % stitches.courses], 2)
        for wale in range(1, wales - 1):  # the border lacks a neighbor
            assert signs[wale] == ("-++-" if row[wale] else "+--+"), (course, wale)


@pytest.mark.parametrize("chart", ["rib_1_1", "rib_2_2"])
def test_knit_wales_of_a_rib_stand_before_its_purl_wales(chart):
    courses, gauge = repeat(chart)
    depth = courses.reshape(len(courses), -1, POINTS_PER_STITCH, 3)[..., 2].mean(axis=(0, 2))
    knit = read_chart(chart).at_least(2).knit[0]
    assert depth[knit].min() - depth[~knit].max() > 2 * gauge.radius


@pytest.mark.parametrize(("chart", "front"), [("cable_4_front", slice(4, 6)), ("cable_4_back", slice(2, 4))])
def test_cables_cross_with_the_named_side_in_front(chart, front):
    """Below the crossing course wales 2, 3 and 4, 5 change sides; c4f brings the right ones to the face."""
    courses, _ = repeat(chart)
    crossing = read_chart(chart).crossings[0]
    below = courses[crossing.course - 1].reshape(-1, POINTS_PER_STITCH, 3)
    heads = below[:, POINTS_PER_STITCH // 2]
    assert heads[2:4, 0].mean() > heads[4:6, 0].mean()
    back = slice(4, 6) if front.start == 2 else slice(2, 4)
    radius = 0.5
    assert heads[front, 2].mean() - heads[back, 2].mean() > 2 * radius


def test_cables_lean_farther_the_wider_they_are_but_not_into_the_next():
    for rows, reach in (
        (["k6"] * 9 + ["c6f"], 3.25),
        (["k4", "c4f"], 1.0),
        (["c4f k4", "k8", "k4 c4f", "k8", "k8", "k8"], 2.5),
        (["c4f k2", "k6", "k2 c4f", "k6", "k6", "k6"], 1.0),
    ):
        chart = read_chart(rows)
        assert cable_reach(chart, chart.crossings[0]) == pytest.approx(reach)


def test_swatch_has_whole_stitches_of_its_gauge():
    yarns = knit_chart_yarns((24.0, 20.0), chart="rib_1_1", stitch_width_mm=4.0)
    assert yarns.yarn_count == round(20.0 / (0.68 * 4.0))
    assert yarns.point_counts.tolist() == [10 * POINTS_PER_STITCH + 1] * yarns.yarn_count
    assert yarns.radius[0] == pytest.approx(0.5)
    middle = 0.5 * (yarns.bounds[0] + yarns.bounds[1])
    assert middle == pytest.approx([0, 0, 0], abs=1.0)
    assert chart_gauge(("k",), 4.0, 5.0, 3.0, 0.3) == Gauge(4.0, 5.0, 3.0, 0.3)


def test_same_cloth_twice_bit_for_bit():
    one, two = (knit_chart_yarns((8.0, 6.0), chart="seed", stitch_width_mm=4.0) for _ in range(2))
    assert np.array_equal(one.points, two.points)
