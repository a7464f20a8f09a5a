"""Plain knit: gauge, interlocking loops, and strands that keep their distance."""

import numpy as np
import pytest

from tests.fiber_model.yarns.distances import clearance, own_clearance
from weft.fiber_model.yarns.fabrics.knit import knit_yarns


def test_swatch_follows_the_gauge():
    yarns = knit_yarns((30.0, 21.0), stitch_width_mm=3.0, course_spacing_mm=2.1)
    assert yarns.yarn_count == 10
    middles = [yarns.yarn(y)[:, 1].min() + np.ptp(yarns.yarn(y)[:, 1]) / 2 for y in range(10)]
    assert np.diff(middles) == pytest.approx(np.full(9, 2.1))
    assert sum(middles) == pytest.approx(0, abs=1e-9)
    first = yarns.yarn(0)
    assert first[[0, -1], 0] == pytest.approx([-15.0, 15.0])
    assert yarns.radius[0] == pytest.approx(3.0 / 8)


@pytest.mark.parametrize(
    ("options", "least"),
    [
        ({}, 0.99),
        ({"course_spacing_mm": 2.5}, 0.99),
        ({"course_spacing_mm": 3.0}, 0.99),
        ({"course_spacing_mm": 3.4}, 0.99),
        ({"radius_mm": 0.35}, 0.99),
        ({"radius_mm": 0.2}, 0.99),
    ],
)
def test_strands_do_not_intersect(options, least):
    yarns = knit_yarns((16.0, 12.0), stitch_width_mm=4.0, **options)
    assert clearance(yarns) > least
    assert own_clearance(yarns, 1) > least


def test_loops_interlock():
    """Every leg of a loop passes in front of the head of the loop below, which lies behind it."""
    yarns = knit_yarns((12.0, 12.0), stitch_width_mm=4.0)
    lower, upper = yarns.yarn(1), yarns.yarn(2)
    heads = lower[np.isclose(lower[:, 1], lower[:, 1].max())]
    assert len(heads) == 3
    assert (heads[:, 2] < 0).all()
    assert upper[:, 1].min() < heads[0, 1]
    at_head_height = upper[np.abs(upper[:, 1] - heads[0, 1]) < 0.3]
    assert (at_head_height[:, 2] > 0).all()


def test_ends_lie_between_loops():
    row = knit_yarns((12.0, 3.0), stitch_width_mm=4.0).yarn(0)
    assert row[[0, -1], 1] == pytest.approx([row[:, 1].min()] * 2)
