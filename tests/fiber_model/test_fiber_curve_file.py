"""Curves of fibers written and read back; damaged files are refused in one line that names them."""

from __future__ import annotations

import numpy as np
import pytest

from weft.fiber_model.fiber_curve_file import read_curves
from weft.fiber_model.fiber_curves import FiberCurves, write_curves
from weft.files.errors import InputError


def curves(**changed):
    fields = {
        "points": np.arange(15, dtype=np.float32).reshape(5, 3),
        "kind": np.array([0, 1, 0, 2, 2], np.uint8),
        "offsets": np.array([0, 3, 5], np.int64),
        "ply": np.array([1, -1], np.int32),
        "yarn": np.array([4, 4], np.int32),
        "fiber_radius_mm": np.array([0.01, 0.02], np.float32),
    }
    return FiberCurves(**(fields | changed))


COLOR = np.linspace(0, 1, 15, dtype=np.float32).reshape(5, 3)


@pytest.mark.parametrize("color", [None, COLOR])
def test_what_was_written_is_read(tmp_path, color):
    written = curves(color=color)
    write_curves(written, tmp_path / "f.npz")
    found = read_curves(tmp_path / "f.npz")
    assert (found.color is None) == (color is None)
    for name, value in vars(written).items():
        if value is None:
            continue
        assert np.array_equal(getattr(found, name), value)
        assert getattr(found, name).dtype == value.dtype


@pytest.mark.parametrize(
    ("changed", "what"),
    [
        ({"points": np.full((5, 3), np.nan, np.float32)}, "curve 0 has a point that is not finite"),
        ({"points": np.zeros((4, 3), np.float32)}, r"points have shape \[4, 3\]"),
        ({"points": np.zeros((5, 3))}, "'points' is float64"),
        ({"offsets": np.array([0, 4, 6])}, "offsets must rise"),
        ({"offsets": np.array([0, 5, 5])}, "offsets must rise"),
        ({"offsets": np.array([], np.int64)}, "offsets must rise"),
        ({"offsets": np.array([1, 3, 5])}, "offsets must rise"),
        ({"color": COLOR[:4]}, r"colors have shape \[4, 3\]; need \[5, 3\]"),
        ({"color": COLOR.astype(np.float64)}, "'color' is float64"),
        ({"color": np.full((5, 3), np.nan, np.float32)}, "a color is not a number"),
        ({"ply": np.zeros(3, np.int32)}, "'ply' has 3 values; need 2"),
        ({"fiber_radius_mm": np.array([0.0, 1.0], np.float32)}, "radius is not a positive number"),
    ],
)
def test_wrong_arrays_are_refused(tmp_path, changed, what):
    write_curves(curves(**changed), tmp_path / "f.npz")
    with pytest.raises(InputError, match=rf"f\.npz: .*{what}"):
        read_curves(tmp_path / "f.npz")


def test_damaged_files_are_refused_and_never_crash(tmp_path):
    whole, broken = tmp_path / "f.npz", tmp_path / "broken.npz"
    write_curves(curves(), whole)
    data = whole.read_bytes()
    rng = np.random.default_rng(1)
    refused = []
    for trial in range(500):
        mutant = bytearray(data)
        if trial % 3 == 0:
            mutant = mutant[: int(rng.integers(len(data)))]
        else:
            for place in rng.integers(len(data), size=trial % 3):
                mutant[place] = int(rng.integers(256))
        broken.write_bytes(mutant)
        try:
            read_curves(broken)
        except InputError as error:
            refused.append(str(error))
    assert len(refused) > 250
    assert all(len(message.splitlines()) == 1 for message in refused)
    with pytest.raises(InputError, match=r"missing\.npz"):
        read_curves(tmp_path / "missing.npz")


def test_a_file_that_would_unpack_to_very_much_is_refused_before(tmp_path, monkeypatch):
    write_curves(curves(points=np.zeros((5, 3), np.float32)), tmp_path / "f.npz")
    monkeypatch.setattr("weft.fiber_model.fiber_curve_file.POINT_LIMIT", 10)
    with pytest.raises(InputError, match="unpacks to"):
        read_curves(tmp_path / "f.npz")
