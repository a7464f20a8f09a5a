"""Every point of a fiber has the color of its ply, lighter and darker along the yarn."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from weft.fiber_model.fiber_colors import has_colors, node_lightness, ply_color
from weft.fiber_model.fiber_curve_file import read_curves
from weft.fiber_model.fiber_curves import FiberSelection, export_curves, write_curves
from weft.fiber_model.fibers import run

RED, BLUE, GREEN = (0.8, 0.1, 0.1), (0.1, 0.2, 0.7), (0.2, 0.6, 0.1)
NOISY = {"color_sd": 0.2, "color_length_mm": 2.0}


def test_plies_have_their_colors(fiber_config, straight_yarn) -> None:
    config = fiber_config("cotton1", cords=2, ply_colors=[RED, BLUE, GREEN, BLUE], fiber_count_scale=0.3)
    fiber_set = run(config, straight_yarn(8.0))
    curves = export_curves(fiber_set)
    first = curves.color[curves.offsets[:-1]]
    body = curves.ply >= 0
    expected = np.array([RED, BLUE, GREEN, BLUE, RED, BLUE], np.float32)  # six plies; the list repeats
    assert (first[body] == expected[curves.ply[body]]).all()
    assert (ply_color(fiber_set, 0, curves.ply[body]) == first[body]).all()
    assert {tuple(c) for c in first[~body].tolist()} == {tuple(c) for c in expected.tolist()}


@pytest.mark.parametrize("closed", [False, True])
def test_colors_vary_along_the_yarn(closed, fiber_config, straight_yarn, yarn_loop) -> None:
    config = fiber_config("cotton1", ply_colors=[RED], variation=NOISY, fiber_count_scale=0.1)
    fiber_set = run(config, yarn_loop(3.0) if closed else straight_yarn(20.0))
    curves = export_curves(fiber_set)
    light = node_lightness(fiber_set, 0)
    assert light.std() > 0.1
    body = curves.color[: curves.offsets[(curves.ply >= 0).sum()]].reshape(-1, len(light), 3)
    assert body == pytest.approx(light[:, None] * np.array(RED, np.float32) * np.ones_like(body), rel=1e-6)
    hairs = curves.color[curves.kind == 2].reshape(-1, config.hair_segments + 1, 3)
    assert (hairs == hairs[:, :1]).all()
    assert hairs.min() >= light.min() * 0.1 * (1 - 1e-6)


def test_fibers_without_colors_have_none(fiber_config, straight_yarn) -> None:
    plain = run(fiber_config("cotton1", fiber_count_scale=0.1), straight_yarn(3.0))
    thick = run(fiber_config("cotton1", variation={"thickness_sd": 0.1}), straight_yarn(3.0))
    assert not has_colors(plain)
    assert not has_colors(thick)
    assert export_curves(plain).color is None
    assert (ply_color(plain, 0, np.arange(3)) == 1).all()
    assert (node_lightness(plain, 0) == 1).all()


def test_colors_stay_with_their_points_through_cutting_and_files(
    fiber_config, straight_yarn, tmp_path
) -> None:
    config = fiber_config("cotton1", ply_colors=[RED, BLUE, GREEN], fiber_count_scale=0.3)
    box = FiberSelection(box_mm=((2.0, -0.5, -9.0), (5.0, 0.4, 9.0)))
    curves = export_curves(run(config, straight_yarn(8.0)), box)
    body = np.repeat(curves.ply, np.diff(curves.offsets))
    expected = np.array([RED, BLUE, GREEN], np.float32)
    assert (curves.color[body >= 0] == expected[body[body >= 0]]).all()
    write_curves(curves, tmp_path / "f.npz")
    assert (read_curves(tmp_path / "f.npz").color == curves.color).all()


def test_yarn_types_have_their_own_colors(fiber_config, straight_yarn) -> None:
    from dataclasses import replace

    yarns = straight_yarn(4.0, count=3)
    yarns = replace(yarns, yarn_type=np.array([0, 1, 0]), type_names=("warp", "weft"))
    config = fiber_config(
        "cotton1", ply_colors=[RED], fiber_count_scale=0.1, by_type={"weft": {"ply_colors": [BLUE]}}
    )
    curves = export_curves(run(config, yarns))
    yarn = np.repeat(curves.yarn, np.diff(curves.offsets))
    assert (curves.color == np.array([RED, BLUE, RED], np.float32)[yarn]).all()


def test_colors_are_between_0_and_1(fiber_config) -> None:
    with pytest.raises(ValidationError):
        fiber_config("cotton1", ply_colors=[(1.2, 0.0, 0.0)])
