"""Tubes are closed, as thick as they say, and face outward."""

from __future__ import annotations

import numpy as np
import pytest

from weft.renderer.surface_config import TubeSurface
from weft.renderer.tubes import SIDES, tube_triangles

BENT = [(0.0, 0.0, 0.0), (10.0, 0.0, 0.0), (10.0, 8.0, 0.0), (10.0, 12.0, 6.0)]


@pytest.mark.parametrize("points", [BENT[:2], BENT])
def test_a_tube_is_closed_and_encloses_its_volume(points):
    """Mitered, its volume is the section times the length of its middle line (Guldin), at every bend."""
    tube = tube_triangles(TubeSurface(points_mm=points, radius_mm=0.5), 3)
    flux = np.einsum("ij,ij->i", tube.corners[:, 0], np.cross(tube.corners[:, 1], tube.corners[:, 2])) / 6
    section = 0.5 * SIDES * 0.25 * np.sin(2 * np.pi / SIDES)
    length = np.linalg.norm(np.diff(np.array(points), axis=0), axis=1).sum()
    assert flux.sum() == pytest.approx(section * length, rel=1e-9)
    area = np.cross(tube.corners[:, 1] - tube.corners[:, 0], tube.corners[:, 2] - tube.corners[:, 0])
    assert np.abs(area.sum(axis=0)).max() < 1e-9
    facing = np.einsum("ij,ikj->ik", area, tube.normals)
    assert (facing > 0).all()
    assert (tube.material == 3).all()


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ([(0, 0, 0), (0, 0, 0)], "neighboring points of a tube are the same"),
        ([(0, 0, 0), (5, 0, 0), (0, 0.1, 0)], "turns back by more than 150 degrees"),
    ],
)
def test_impossible_tubes_are_refused(points, message):
    with pytest.raises(ValueError, match=message):
        TubeSurface(points_mm=points)
