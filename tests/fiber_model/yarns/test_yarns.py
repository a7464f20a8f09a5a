"""Yarn sets: what is refused, and that files give back what was written."""

import contextlib

import numpy as np
import pytest

from weft.fiber_model.yarns.yarn_file import load_yarns, save_yarns
from weft.fiber_model.yarns.yarns import YarnSet, concatenate
from weft.files.errors import InputError

LINE = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0.5, 0], [3, 0.5, 1], [4, 0, 1]])


def sample_set() -> YarnSet:
    return YarnSet.checked(
        [LINE, LINE[:4] + 5],
        closed=[False, True],
        radius=[0.5, 0.25],
        yarn_type=[0, 1],
        type_names=("warp", "weft"),
        twist=[np.arange(5.0), np.arange(4.0)],
        surface_uv=[LINE[:, :2], LINE[:4, :2]],
    )


def assert_equal_sets(a: YarnSet, b: YarnSet) -> None:
    assert a.type_names == b.type_names
    for name in ("points", "offsets", "closed", "radius", "yarn_type", "twist", "surface_uv"):
        one, other = getattr(a, name), getattr(b, name)
        assert (one is None) == (other is None)
        if one is not None:
            assert one.dtype == other.dtype
            assert np.array_equal(one, other)


def test_saved_set_is_read_back_equal(tmp_path):
    save_yarns(sample_set(), tmp_path / "yarns.npz")
    assert_equal_sets(load_yarns(tmp_path / "yarns.npz"), sample_set())
    bare = YarnSet.checked([LINE], radius=1.0)
    save_yarns(bare, tmp_path / "yarns.npz")
    assert_equal_sets(load_yarns(tmp_path / "yarns.npz"), bare)
    assert [path.name for path in tmp_path.iterdir()] == ["yarns.npz"]


def test_bounds_include_the_radius():
    assert np.array_equal(YarnSet.checked([LINE], radius=0.5).bounds, [[-0.5, -0.5, -0.5], [4.5, 1.0, 1.5]])


def test_concatenation_keeps_every_yarn_and_joins_types_by_name():
    other = YarnSet.checked([LINE + 9], radius=2.0, type_names=("weft",))
    joined = concatenate([sample_set(), other])
    assert joined.type_names == ("warp", "weft")
    assert joined.yarn_type.tolist() == [0, 1, 1]
    assert np.array_equal(joined.yarn(2), LINE + 9)
    assert joined.twist is not None
    assert joined.twist.tolist() == [0, 1, 2, 3, 4, 0, 1, 2, 3, 0, 0, 0, 0, 0]


def spoiled(point: int, value: float) -> np.ndarray:
    curve = LINE.copy()
    curve[point, 1] = value
    return curve


@pytest.mark.parametrize(
    ("curves", "options", "message"),
    [
        ([LINE, LINE[:1]], {}, "yarn 1 has 1 control point; a centerline needs at least 4"),
        ([LINE[:3]], {}, "yarn 0 has 3 control points; a centerline needs at least 4"),
        ([LINE, spoiled(2, np.nan)], {}, "yarn 1, point 2 is not finite: (2, nan, 0) mm"),
        ([spoiled(0, np.inf)], {}, "yarn 0, point 0 is not finite: (0, inf, 0) mm"),
        (
            [spoiled(3, 1e9)],
            {},
            "yarn 0, point 3 lies at (3, 1e+09, 1) mm, beyond ten kilometers; check the unit",
        ),
        ([LINE], {"radius": 0.0}, "yarn 0 has radius 0 mm; need a positive number"),
        ([LINE], {"radius": np.nan}, "yarn 0 has radius nan mm; need a positive number"),
        ([LINE], {"yarn_type": 1}, "yarn 0 has type 1, but there are 1 type names"),
        ([0 * LINE + 3], {}, "yarn 0 has no length: all its points coincide"),
        ([], {}, "there are no yarns; need at least one"),
        ([LINE], {"twist": [np.full(5, np.nan)]}, "yarn 0, point 0 has a twist or (u, v) that is not finite"),
    ],
)
def test_bad_yarns_are_refused(curves, options, message):
    with pytest.raises(InputError) as caught:
        YarnSet.checked(curves, **({"radius": 1.0} | options), source="job.bcc")
    assert str(caught.value) == f"job.bcc: {message}"


def test_offsets_must_fit_the_points():
    with pytest.raises(InputError, match="yarn offsets must rise from 0 to the number of points, 5"):
        YarnSet(LINE, np.array([0, 9]), np.array([False]), np.array([1.0]), np.array([0]))


def test_damaged_files_are_refused(tmp_path):
    path = tmp_path / "yarns.npz"
    save_yarns(sample_set(), path)
    whole = path.read_bytes()
    rng = np.random.default_rng(3)
    for _ in range(200):
        damaged = bytearray(whole[: rng.integers(len(whole))] if rng.random() < 0.3 else whole)
        for _ in range(rng.integers(1, 4)):
            if damaged:
                damaged[rng.integers(len(damaged))] = rng.integers(256)
        path.write_bytes(bytes(damaged))
        with contextlib.suppress(InputError):  # and nothing else
            load_yarns(path)


def test_other_files_are_refused(tmp_path):
    np.savez(tmp_path / "other.npz", points=LINE)
    np.savez(tmp_path / "newer.npz", schema="weft.yarns", schema_version=99)
    (tmp_path / "text.npz").write_text("hello")
    for name, message in [
        ("other.npz", "not a yarn file written by weft"),
        ("newer.npz", "yarn file of version 99; this weft reads 1"),
        ("text.npz", "not a readable .npz yarn file; is it damaged?"),
        ("absent.npz", "no such file"),
    ]:
        with pytest.raises(InputError) as caught:
            load_yarns(tmp_path / name)
        assert str(caught.value) == f"{tmp_path / name}: {message}"
