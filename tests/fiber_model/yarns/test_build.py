"""The yarn stage: each kind of config makes its yarns."""

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from weft.fiber_model.yarns.build import run
from weft.fiber_model.yarns.config import YarnsConfig
from weft.fiber_model.yarns.yarn_file import save_yarns
from weft.fiber_model.yarns.yarns import YarnSet

CONFIG = TypeAdapter(YarnsConfig)
KNIT = {"kind": "knit", "size_mm": [9, 9], "stitch_width_mm": 3}
OBJ = "".join(f"v {i} {i % 2} 0\n" for i in range(5)) + "l 1 2 3 4 5\n"


def build(**table):
    return run(CONFIG.validate_python(table))


@pytest.mark.parametrize(
    "table",
    [
        {"kind": "weave"},
        {"kind": "weave", "draft": "satin_5", "type_names": ["warp", "weft"]},
        {"kind": "weave", "draft": [[1, 1, 0], [0, 1, 1], [1, 0, 1]]},
        {"kind": "weave", "draft": ["xx.", ".xx", "x.x"]},
        {"kind": "knit", "stitch_width_mm": 3.0, "type_name": "wool"},
        {"kind": "knit", "stitch_width_mm": 3.0, "chart": "garter", "type_name": "wool"},
        {"kind": "knit", "stitch_width_mm": 3.0, "chart": ["k p2", "p k2"], "course_spacing_mm": 2.0},
    ],
)
def test_generated_cloth_has_its_size(table):
    yarns = build(size_mm=[12.0, 9.0], **table)
    extent = (yarns.bounds[1] - yarns.bounds[0])[:2]
    assert extent == pytest.approx([12.0, 9.0], abs=3.0)


def test_files_give_yarns_and_saved_yarns_come_back(tmp_path):
    (tmp_path / "yarns.obj").write_text(OBJ)
    table = {"kind": "file", "file": tmp_path / "yarns.obj", "scale_to_mm": 10.0, "radius_mm": 0.5}
    yarns = build(**table)
    save_yarns(yarns, tmp_path / "yarns.npz")
    again = build(kind="file", file=tmp_path / "yarns.npz", radius_mm=0.25)
    assert np.array_equal(again.points, yarns.points)
    assert again.radius.tolist() == [0.25]


def test_tile_covers_the_cloth(shared_data):
    tile = shared_data / "yarn_patterns" / "stockinette.pyp"
    yarns = build(kind="tile", tile=tile, size_mm=[40, 40], scale_to_mm=250)
    assert isinstance(yarns, YarnSet)
    assert yarns.radius == pytest.approx(np.full(yarns.yarn_count, 0.25))
    assert np.abs(yarns.points[:, :2]).max(axis=0) == pytest.approx([20.0, 20.0], abs=1.0)
    assert yarns.twist is not None


def test_progress_is_told():
    heard: list[tuple[float, str]] = []
    table = {"kind": "knit", "size_mm": [9, 9], "stitch_width_mm": 3}
    run(CONFIG.validate_python(table), progress=lambda fraction, detail: heard.append((fraction, detail)))
    assert heard[-1] == (1.0, "5 yarns of 485 points")


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"file": "y.obj", "radius_mm": 1}, "'scale_to_mm' must be given"),
        ({"file": "y.obj", "scale_to_mm": 1}, "'radius_mm' must be given"),
        ({"file": "y.npz", "scale_to_mm": 1}, "remove 'scale_to_mm'"),
        ({"file": "y.pyp"}, "kind = 'tile'"),
        ({"kind": "knit", "size_mm": [9, 9], "stitch_width_mm": 3, "radius_mm": 1}, "too thick"),
        ({"kind": "knit", "size_mm": [9, 9], "stitch_width_mm": 3, "course_spacing_mm": 9}, "0.4 to 1.5"),
        ({"kind": "knit", "size_mm": [9, float("nan")], "stitch_width_mm": 3}, "finite"),
        (KNIT | {"wale_spacing_mm": 3.0}, "remove 'wale_spacing_mm'"),
        (KNIT | {"wale_spacing_mm": 1.0, "chart": "rib_1_1"}, "0.5 to 1.5 times"),
        (KNIT | {"chart": "rib"}, "rib_1_1"),
        ({"kind": "weave", "size_mm": [9, 9], "warp_per_cm": 0}, "greater than 0"),
        ({"kind": "weave", "size_mm": [9, 9], "draft": ["x.", "xo"]}, "found 'o' in 'xo'"),
        ({"kind": "weave", "size_mm": [9, 9], "type_names": ["a", "b", "c"]}, "at most 2"),
    ],
)
def test_bad_tables_are_refused(tmp_path, monkeypatch, table, message):
    monkeypatch.chdir(tmp_path)
    for name in ("y.obj", "y.npz", "y.pyp"):
        (tmp_path / name).write_text("")
    with pytest.raises(ValidationError, match=message):
        CONFIG.validate_python({"kind": "file"} | table)
