"""Exported curves: what is selected, how it is joined and cut, what is written."""

from __future__ import annotations

import numpy as np
import pytest

from weft.fiber_model import fiber_curves
from weft.fiber_model.fiber_curves import FiberCurves, FiberSelection, export_curves, write_curves
from weft.fiber_model.fibers import FiberSet, run
from weft.files.errors import InputError


@pytest.fixture(scope="module")
def fiber_set(fiber_config, straight_yarn) -> FiberSet:
    return run(fiber_config("cotton2", fiber_count_scale=4.0, fuzz=2.0), straight_yarn(12.0, count=3))


def _segments(curves: FiberCurves) -> set[bytes]:
    """All segments as bytes."""
    pairs = np.stack([curves.points[:-1], curves.points[1:]], axis=1)
    keep = np.ones(len(pairs), bool)
    keep[curves.offsets[1:-1] - 1] = False
    return {pair.tobytes() for pair in pairs[keep]}


def test_body_fibers_run_from_end_to_end(fiber_set) -> None:
    curves = export_curves(fiber_set)
    body = curves.ply >= 0
    assert body.sum() == fiber_set.report.body_fiber_count
    assert (np.diff(curves.offsets)[body] == fiber_set.yarns["intervals"][0] + 1).all()
    assert curves.curve_count - body.sum() == fiber_set.report.hair_count
    assert np.unique(curves.ply).tolist() == [-1, 0, 1, 2]
    assert set(curves.kind.tolist()) == {0, 1, 2}
    assert (curves.fiber_radius_mm == np.float32(0.008)).all()


def test_selecting_yarns_takes_just_these(fiber_set) -> None:
    curves = export_curves(fiber_set, FiberSelection(yarns=(1, 2)))
    assert (curves.yarn == 1).all()
    assert (curves.ply >= 0).sum() * 3 == fiber_set.report.body_fiber_count


def test_selecting_arc_length_cuts_at_whole_segments(fiber_set) -> None:
    curves = export_curves(fiber_set, FiberSelection(yarns=(0, 1), arc_length_mm=(3.0, 5.0)))
    step = fiber_set.report.segment_mm
    x = np.stack([curves.points[curves.offsets[:-1], 0], curves.points[curves.offsets[1:] - 1, 0]])
    x = x[:, curves.ply >= 0]
    assert ((x[0] <= 3.0 + 1e-5) & (x[0] > 3.0 - step - 1e-5)).all()
    assert ((x[1] >= 5.0 - 1e-5) & (x[1] < 5.0 + step + 1e-5)).all()


def test_selecting_a_box_keeps_every_segment_that_touches_it(fiber_set) -> None:
    box = ((2.0, -0.5, 0.2), (4.0, 0.4, 2.0))
    chosen, every = export_curves(fiber_set, FiberSelection(box_mm=box)), export_curves(fiber_set)
    low, high = np.asarray(box)
    inside = ((every.points >= low) & (every.points <= high)).all(axis=1)
    pairs = np.stack([every.points[:-1], every.points[1:]], axis=1)
    touching = inside[:-1] | inside[1:]
    touching[every.offsets[1:-1] - 1] = False
    assert _segments(chosen) == {pair.tobytes() for pair in pairs[touching]}
    assert (np.diff(chosen.offsets) >= 2).all()


def test_an_empty_selection_is_empty(fiber_set) -> None:
    curves = export_curves(fiber_set, FiberSelection(yarns=(7, 9)))
    assert curves.curve_count == 0
    assert curves.points.shape == (0, 3)
    assert curves.offsets.tolist() == [0]


def test_npz_holds_all_fields(fiber_set, tmp_path) -> None:
    curves = export_curves(fiber_set, FiberSelection(yarns=(0, 1)))
    write_curves(curves, tmp_path / "part.npz")
    with np.load(tmp_path / "part.npz", allow_pickle=False) as stored:
        assert str(stored["units"]) == "mm"
        given = {name: values for name, values in vars(curves).items() if values is not None}
        assert set(stored.files) == {"units", *given}
        for name, values in given.items():
            assert (stored[name] == values).all()


def test_obj_holds_the_same_polylines(fiber_set, tmp_path) -> None:
    curves = export_curves(fiber_set, FiberSelection(yarns=(1, 3), arc_length_mm=(0.0, 1.0)))
    write_curves(curves, tmp_path / "part.obj")
    lines = [line.split() for line in (tmp_path / "part.obj").read_text().splitlines()]
    points = np.array([line[1:] for line in lines if line[0] == "v"], dtype=float)
    assert np.abs(points - curves.points).max() < 1e-6
    polylines = [np.array(line[1:], dtype=int) - 1 for line in lines if line[0] == "l"]
    expected = [np.arange(a, b) for a, b in zip(curves.offsets, curves.offsets[1:], strict=False)]
    assert all((a == b).all() for a, b in zip(polylines, expected, strict=True))
    assert [line[1] for line in lines if line[0] == "g"] == ["yarn_1", "yarn_2"]


def test_refuses_unknown_suffix_and_writes_nothing(fiber_set, tmp_path) -> None:
    curves = export_curves(fiber_set, FiberSelection(yarns=(0, 1), arc_length_mm=(0.0, 1.0)))
    with pytest.raises(InputError, match=r"Use .npz or .obj"):
        write_curves(curves, tmp_path / "part.abc")
    assert list(tmp_path.iterdir()) == []


def test_refuses_more_points_than_it_should_store(fiber_set, monkeypatch) -> None:
    monkeypatch.setattr(fiber_curves, "POINT_LIMIT", 1000)
    with pytest.raises(InputError, match="Choose fewer yarns"):
        export_curves(fiber_set)
