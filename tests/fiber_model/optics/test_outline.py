"""Outlines are the shapes they claim to be."""

from __future__ import annotations

import numpy as np
import pytest

from weft.fiber_model.optics.cross_sections import build_outline, circle, ellipse, lobed, polygon
from weft.fiber_model.optics.outline import Outline
from weft.files.errors import InputError

from .optics_cases import SHAPES


def _shape(name: str) -> Outline:
    return build_outline(SHAPES[name])


def test_a_circle_is_exactly_round() -> None:
    outline = circle(0.7)
    assert outline.curvatures == pytest.approx(1 / 0.7, rel=1e-12)
    assert outline.area == pytest.approx(np.pi * 0.49, rel=1e-12)
    assert outline.perimeter == pytest.approx(1.4 * np.pi, rel=1e-12)
    assert outline.mean_width == pytest.approx(1.4, rel=1e-4)
    assert outline.convex


@pytest.mark.parametrize("name", SHAPES)
def test_arcs_join_end_to_end_and_close(name: str) -> None:
    outline = _shape(name)
    assert outline.ends == pytest.approx(np.roll(outline.starts, -1, axis=0), abs=1e-12)
    if name != "notched":
        assert outline.end_tangents == pytest.approx(np.roll(outline.start_tangents, -1, axis=0), abs=1e-9)


@pytest.mark.parametrize("name", SHAPES)
def test_points_lie_on_their_arcs(name: str) -> None:
    outline = _shape(name)
    points = outline.points(9).reshape(len(outline), 8, 2)
    d = points - outline.starts[:, None]
    left = np.stack([-outline.start_tangents[:, 1], outline.start_tangents[:, 0]], axis=1)
    equation = outline.curvatures[:, None] * (d**2).sum(-1) - 2 * (d * left[:, None]).sum(-1)
    assert np.abs(equation).max() < 1e-12


@pytest.mark.parametrize("name", SHAPES)
def test_area_is_that_of_the_points(name: str) -> None:
    outline = _shape(name)
    x, y = outline.points(200).T
    assert outline.area == pytest.approx(0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum(), rel=1e-5)


def test_arcs_follow_an_ellipse_and_a_lobed_curve() -> None:
    x, y = ellipse(1.0, 0.4).points().T
    assert np.abs(x**2 + (y / 0.4) ** 2 - 1).max() < 2e-3
    x, y = lobed(1.0, 3, 0.2).points().T
    assert np.abs(np.hypot(x, y) - 1 - 0.2 * np.cos(3 * np.arctan2(y, x))).max() < 2e-3
    assert ellipse(1.0, 0.4).area == pytest.approx(0.4 * np.pi, rel=1e-3)


def test_which_shapes_have_dents() -> None:
    convex = {name for name in SHAPES if _shape(name).convex}
    assert convex == {"circle", "ellipse", "triangle"}


def test_a_clockwise_polygon_is_turned_around() -> None:
    corners = np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]])
    assert polygon(corners).area == pytest.approx(1.0)


@pytest.mark.parametrize(
    "corners",
    [
        [(0, 0), (1, 1), (1, 0), (0, 1)],
        [(0, 0), (2, 0), (1, 0), (1, 1)],
        [(0, 0), (0, 0), (1, 0), (1, 1)],
    ],
    ids=["crossing", "folded", "doubled"],
)
def test_what_is_no_simple_polygon_is_refused(corners: list[tuple[float, float]]) -> None:
    with pytest.raises(InputError, match="vertices_mm"):
        polygon(np.array(corners, dtype=np.float64))
