"""Stripes follow the pattern, dye lots the yarn, heather the ply."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest

from weft.fiber_model import yarn_nodes
from weft.fiber_model.config import FibersConfig
from weft.fiber_model.fiber_colors import has_colors, ply_color
from weft.fiber_model.fibers import run as lay_fibers
from weft.fiber_model.yarn_colors import yarn_palettes
from weft.fiber_model.yarns.build import run as make_yarns
from weft.fiber_model.yarns.config import GarmentConfig, KnitConfig, WeaveConfig
from weft.fiber_model.yarns.yarn_file import load_yarns, save_yarns

from .conftest import PRESETS

COTTON = FibersConfig(
    preset="cotton2", **tomllib.loads((PRESETS / "cotton2.toml").read_text(encoding="utf-8"))
)
RED, WHITE = (0.8, 0.1, 0.1), (1.0, 1.0, 1.0)
STRIPES = {"yarn_colors": (RED, WHITE), "yarn_color_runs": (3, 2)}


def colored(**values):
    return COTTON.model_copy(update=values)


def palettes(yarns, **values):
    return yarn_palettes([colored(**values)] * yarns.yarn_count, yarns, 1)


@pytest.fixture(scope="module")
def knit():
    return make_yarns(KnitConfig(kind="knit", size_mm=(20.0, 40.0), stitch_width_mm=6.0))


def test_stripes_count_courses(knit):
    found = [palette[0] for palette in palettes(knit, **STRIPES)]
    assert found == [(RED, WHITE)[i % 5 > 2] for i in range(knit.yarn_count)]
    assert knit.yarn_count > 6


def test_stripes_of_a_weave_count_warp_and_weft_apart():
    weave = make_yarns(WeaveConfig(kind="weave", size_mm=(5.0, 9.0), type_names=["warp", "weft"]))
    colors = np.array([palette[0] for palette in palettes(weave, **STRIPES)])
    for kind in (0, 1):
        own = colors[weave.yarn_type == kind]
        np.testing.assert_array_equal(own[:5], [RED, RED, RED, WHITE, WHITE])


def test_stripes_of_a_garment_keep_their_height(tmp_path, monkeypatch):
    """Every course of a sleeve, whole or cut in pieces, has the color of its height."""
    surface = {
        "kind": "sleeve",
        "length_mm": 90.0,
        "cuff_girth_mm": 60.0,
        "top_girth_mm": 80.0,
        "fold_depth_mm": 3.0,
    }
    pattern = {"kind": "knit", "stitch_width_mm": 6.0}
    job = {"kind": "garment", "surface": surface, "pattern": pattern, "hem_mm": 2.0}
    sleeve = make_yarns(GarmentConfig.model_validate(job))
    assert sleeve.row is not None
    height = np.array([sleeve.yarn(i)[:, 1].mean() for i in range(sleeve.yarn_count)])
    courses = sleeve.closed
    order = np.argsort(height[courses])
    steps = np.diff(sleeve.row[courses][order])
    assert courses.sum() > 10
    assert (steps[1:-1] == 1).all()  # the first and the last are to the hems
    monkeypatch.setattr(yarn_nodes, "GROUP_NODES", 1000)
    assert len(lay_fibers(colored(**STRIPES), sleeve).colors) == 2
    save_yarns(sleeve, tmp_path / "yarns.npz")
    np.testing.assert_array_equal(load_yarns(tmp_path / "yarns.npz").row, sleeve.row)


def test_dye_lots_differ_by_yarn_and_heather_by_ply():
    rows = make_yarns(KnitConfig(kind="knit", size_mm=(12.0, 2000.0), stitch_width_mm=6.0))
    for name, columns in (("yarn_color_sd", 1), ("ply_color_sd", COTTON.plies)):
        varied = colored(variation=COTTON.variation.model_copy(update={name: 0.2}))
        found = np.array(yarn_palettes([varied] * rows.yarn_count, rows, 1))[..., 0]
        assert found.shape == (rows.yarn_count, columns)
        assert len(np.unique(found)) == found.size
        error = 1 / np.sqrt(found.size)
        assert abs(found.mean() - 1) < 3.9 * 0.2 * error
        assert found.std() == pytest.approx(0.2, abs=3.9 * 0.2 * error)


def test_ply_colors_are_multiplied_into_the_yarns(knit):
    fibers = lay_fibers(colored(ply_colors=((0.5, 0.5, 0.5), (1.0, 1.0, 0.0)), **STRIPES), knit)
    np.testing.assert_allclose(
        ply_color(fibers, 0, np.arange(2)), [np.multiply(RED, 0.5), (0.8, 0.1, 0)], 1e-6
    )
    np.testing.assert_allclose(ply_color(fibers, 3, np.arange(2)), [(0.5, 0.5, 0.5), (1, 1, 0)])


def test_yarns_without_colors_stay_white(knit):
    assert not has_colors(lay_fibers(COTTON, knit))
    assert set(palettes(knit)) == {()}
