"""Hems run around every free border, outside of the cloth they hold."""

import numpy as np
import pytest

from tests.fiber_model.yarns.garments.meshes import cylinder, plane
from weft.fiber_model.yarns.garments.borders import free_borders
from weft.fiber_model.yarns.garments.hems import Stitches, hem_yarns

STITCHES = Stitches(depth_mm=3.0, half_thickness_mm=1.0, radius_mm=0.5)


@pytest.mark.parametrize(("mesh", "count"), [(plane(), 1), (cylinder(), 2)])
def test_every_border_is_hemmed_by_one_loop(mesh, count):
    assert len(free_borders(mesh)) == count
    hem = hem_yarns(mesh, STITCHES)
    assert hem.yarn_count == count
    assert hem.closed.all()


def test_stitches_go_over_the_border_and_reach_their_depth():
    hem = hem_yarns(cylinder(height=40.0), STITCHES)
    lower = hem.points[hem.points[:, 1] < 20]
    assert lower[:, 1].max() == pytest.approx(3.0, abs=0.05)
    assert lower[:, 1].min() == pytest.approx(-1.0, abs=0.05)
    height = np.hypot(lower[:, 0], lower[:, 2]) - 20
    assert height.max() == pytest.approx(2.0, abs=0.1)
    assert height.min() == pytest.approx(-2.0, abs=0.1)


def test_stitches_clear_the_cloth():
    """Where a stitch passes the border it is a full yarn away from centerlines of the cloth."""
    points = hem_yarns(plane(), STITCHES).points
    inside = (points[:, 0] > 0.3) & (points[:, 0] < 39.7) & (points[:, 1] > 0.3) & (points[:, 1] < 29.7)
    through = inside & (np.abs(points[:, 2]) < 1.0)
    distance = np.minimum.reduce([points[:, 0], 40 - points[:, 0], points[:, 1], 30 - points[:, 1]])
    assert distance[through].min() > 1.5


def test_a_border_too_short_for_stitches_is_left():
    assert hem_yarns(plane(1.0, 1.0), STITCHES) is None
