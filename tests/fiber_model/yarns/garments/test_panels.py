"""Panels: where a garment is cut, and how flat pieces come out."""

import numpy as np
import pytest

from tests.fiber_model.yarns.garments.meshes import cylinder, mapped, plane
from weft.fiber_model.yarns.garments.charts import build_charts
from weft.fiber_model.yarns.garments.garment_report import principal_stretches
from weft.fiber_model.yarns.garments.mesh_files import read_mesh
from weft.fiber_model.yarns.garments.panels import (
    boundary_loop,
    cut_panels,
    flatten,
    panel_of_faces,
    without_ears,
)
from weft.files.errors import InputError


def cap(angle):
    """The part of a sphere of radius 50 mm within `angle` of +z, as a grid bent over it."""

    def surface(u, v):
        tilt = np.hypot(u, v)
        around = np.arctan2(v, u)
        flat = np.sin(tilt)
        return 50 * np.stack([flat * np.cos(around), flat * np.sin(around), np.cos(tilt)], axis=-1)

    side = np.linspace(-angle, angle, 21)
    return mapped(surface, side, side)


def test_developable_cloth_is_laid_flat_without_stretch():
    """A third of a tube and a bent strip come out as they were, to rounding."""

    def arch(u, v):
        return np.stack([30 * np.sin(u / 30), v, 30 * np.cos(u / 30)], axis=-1)

    mesh = mapped(arch, np.linspace(-30, 30, 25), np.linspace(0, 80, 33))
    flat = flatten(mesh.vertices, mesh.faces)
    edge = mesh.faces[:, [0, 1]]
    on_surface = np.linalg.norm(np.diff(mesh.vertices[edge], axis=1)[:, 0], axis=1)
    laid = np.linalg.norm(np.diff(flat[edge], axis=1)[:, 0], axis=1)
    assert laid / on_surface == pytest.approx(np.ones(len(edge)), abs=2e-3)


def test_a_dome_is_flattened_with_little_stretch_and_not_mirrored():
    """A cap cannot be flat; as rigid as possible spreads the strain, whose size is about (angle)^2 / 6."""
    mesh = cut_panels(cap(0.5))
    (chart,) = build_charts(mesh)
    stretch = principal_stretches(mesh, chart)
    assert len(chart.faces) == mesh.face_count
    assert stretch.min() > 1 - 0.5**2 / 3
    assert stretch.max() < 1 + 0.5**2 / 3
    # flat and seen from outside, not from behind: all triangles counterclockwise in (u, v)
    a, b = mesh.uv[:, 1] - mesh.uv[:, 0], mesh.uv[:, 2] - mesh.uv[:, 0]
    assert (a[:, 0] * b[:, 1] > a[:, 1] * b[:, 0]).all()


def test_a_tube_is_cut_into_front_and_back():
    mesh = cylinder()
    panel = panel_of_faces(mesh)
    assert panel.max() == 1
    facing = mesh.vertices[mesh.faces].mean(axis=1)[:, 2]
    front = panel == panel[np.argmax(facing)]
    assert facing[front].min() > -3
    assert facing[~front].max() < 3
    charts = build_charts(cut_panels(mesh), grain="up")
    extent = np.array([chart.bounds[1] - chart.bounds[0] for chart in charts])
    assert extent.min(axis=0) == pytest.approx([20 * np.pi, 40], rel=0.1)
    assert extent.max(axis=0) == pytest.approx([20 * np.pi, 40], rel=0.1)


def test_ears_go_over_to_the_other_side():
    neighbor = np.array([[1, 1, 1], [0, 2, 3], [1, 1, 1], [1, 4, 4], [3, 3, 3]])
    front = np.array([False, True, False, True, True])
    assert without_ears(front, neighbor).tolist() == [False, False, False, True, True]


def test_a_border_is_found_in_order():
    mesh = plane()
    loop = boundary_loop(mesh.faces, len(mesh.vertices))
    step = np.linalg.norm(np.diff(mesh.vertices[np.append(loop, loop[0])], axis=0), axis=1)
    assert step == pytest.approx(np.full(len(loop), 5.0))
    assert step.sum() == pytest.approx(140.0)


def test_what_is_no_disk_is_refused():
    mesh = cylinder()
    with pytest.raises(InputError, match="cannot be laid flat in one piece"):
        flatten(mesh.vertices, mesh.faces)


def test_the_shirt_comes_in_two_panels(shared_data):
    pytest.importorskip("pxr", reason="usd-core is an extra: pip install usd-core")
    mesh = cut_panels(read_mesh(shared_data / "garments" / "unisex_shirt.usd", scale_to_mm=10.0))
    charts = build_charts(mesh, grain="up")
    assert len(charts) == 2
    stretch = np.concatenate([principal_stretches(mesh, chart) for chart in charts])
    assert np.quantile(stretch[:, 0], 0.01) > 0.85
    assert np.quantile(stretch[:, 1], 0.99) < 1.25
