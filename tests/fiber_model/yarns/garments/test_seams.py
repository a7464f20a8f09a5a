"""Seams where the ends of yarns on both sides do not meet."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from tests.fiber_model.yarns.garments.meshes import cylinder
from weft.fiber_model.yarns.build import run
from weft.fiber_model.yarns.config import KnitPattern
from weft.fiber_model.yarns.garments.borders import chart_seams
from weft.fiber_model.yarns.garments.charts import build_charts
from weft.fiber_model.yarns.garments.garment import flat_pattern
from weft.fiber_model.yarns.garments.on_mesh import lay_on_mesh
from weft.fiber_model.yarns.garments.surface_mesh import SurfaceMesh

RADIUS, HEIGHT, AROUND, UP = 20.0, 60.0, 48, 24


def tube_in_two_charts(shift):
    """A tube, its second half `shift` mm higher in v than the first."""
    angle, z = 2 * np.pi * np.arange(AROUND) / AROUND, np.linspace(0, HEIGHT, UP + 1)
    vertices = [(RADIUS * np.cos(t), y, -RADIUS * np.sin(t)) for y in z for t in angle]
    u, faces, uv = 2 * np.pi * RADIUS * np.arange(AROUND + 1) / AROUND, [], []
    for j in range(UP):
        for i in range(AROUND):
            second = i >= AROUND // 2
            corner = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
            index = [row * AROUND + column % AROUND for column, row in corner]
            place = [(u[column] + 200 * second, z[row] + shift * second) for column, row in corner]
            for triangle in ((0, 1, 2), (0, 2, 3)):
                faces.append([index[k] for k in triangle])
                uv.append([place[k] for k in triangle])
    return SurfaceMesh.checked(np.array(vertices), np.array(faces), np.array(uv), uv_unit_mm=1.0)


@pytest.mark.parametrize("shift", [0.0, 1.3, 2.6])
def test_every_end_that_nothing_continues_is_counted(shift):
    mesh = tube_in_two_charts(shift)
    pattern = flat_pattern(KnitPattern(kind="knit", stitch_width_mm=8.0), run)
    yarns = lay_on_mesh(mesh, build_charts(mesh), pattern, hem_mm=6.0)
    stitched = 2  # an open yarn over each of the two seams
    assert 2 * (int((~yarns.closed).sum()) - stitched) == yarns.report.open_end_count > 0
    assert yarns.report.loop_count == int(yarns.closed.sum())


def test_seams_are_stitched_where_yarns_end():
    """All open ends, at the two seams and the rims, have stitches within the depth of one."""
    mesh = tube_in_two_charts(1.3)
    pattern = flat_pattern(KnitPattern(kind="knit", stitch_width_mm=8.0), run)
    bare, hemmed = (lay_on_mesh(mesh, build_charts(mesh), pattern, hem_mm=depth) for depth in (0.0, 6.0))
    assert hemmed.yarn_count - bare.yarn_count == 2 + 2
    starts, stops = bare.offsets[:-1][~bare.closed], bare.offsets[1:][~bare.closed] - 1
    ends = bare.points[np.concatenate([starts, stops])]
    stitches = hemmed.points[len(bare.points) :]
    assert cKDTree(stitches).query(ends)[0].max() < 6.0
    along_seams = np.abs(stitches[np.abs(stitches[:, 1] - HEIGHT / 2) < HEIGHT / 4])
    assert len(along_seams) > 100
    assert along_seams[:, 2].max() < 6.5  # the seams lie at z = 0


def test_chart_seams_are_found_once():
    (one, two), whole = chart_seams(tube_in_two_charts(0.0)), chart_seams(cylinder())
    assert not one.closed
    assert len(one.half_edges) == len(two.half_edges) == UP
    assert len(whole) == (1 if cylinder().uv is not None else 0)
