"""The OBJ polyline reader."""

import contextlib

import numpy as np
import pytest

from weft.fiber_model.yarns.formats.obj_lines import read_obj_lines
from weft.files.errors import InputError

VERTICES = np.array([[0.0, 0, 0], [1, 0, 0], [2, 1, 0], [3, 1, 1], [4, 0, 1]])


def write(path, text):
    lines = [f"v {x} {y} {z}" for x, y, z in VERTICES]
    path.write_text("# a test\no yarn\n" + "\n".join(lines) + "\n" + text)
    return path


def read(path, **options):
    return read_obj_lines(path, **({"scale_to_mm": 2.0, "radius_mm": 0.5} | options))


def test_polylines_are_read(tmp_path):
    path = write(tmp_path / "yarns.obj", "l 1 2 3 4 5 # open\ns off\nl -5/1 -4/2 -3/3 -2/4 -5/1\n")
    yarns = read(path, type_name="wool")
    assert yarns.closed.tolist() == [False, True]
    assert np.array_equal(yarns.yarn(0), 2 * VERTICES)
    assert np.array_equal(yarns.yarn(1), 2 * VERTICES[:4])
    assert yarns.type_names == ("wool",)


def test_segments_that_follow_each_other_are_one_yarn(tmp_path):
    text = "l 1 2\nl 2 3\nl 3 4\nl 4 5\nl 1 2 3 4 1\nl 1 3 5 2\n"
    yarns = read(write(tmp_path / "yarns.obj", text))
    assert yarns.point_counts.tolist() == [5, 4, 4]
    assert yarns.closed.tolist() == [False, True, False]


def test_z_up_is_turned_to_y_up(tmp_path):
    yarns = read(write(tmp_path / "yarns.obj", "l 1 2 3 4 5\n"), scale_to_mm=1.0, up_axis=2)
    assert np.array_equal(yarns.yarn(0), VERTICES[:, [0, 2, 1]] * [1, 1, -1])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", " no polylines ('l' statements) in this file"),
        ("l 1 2 3\n", "8: yarn 0 has 3 control points; a centerline needs at least 4"),
        ("l 3\n", "8: yarn 0 has 1 control point; a centerline needs at least 4"),
        ("l 1 2 3 9\n", "8: vertex 9, but there are 5 before this line (counted from 1)"),
        ("l 1 2 3 0\n", "8: vertex 0, but there are 5 before this line (counted from 1)"),
        ("l 1 2 3 x\n", "8: not a vertex: 'x'"),
        ("v 1 nan 2\n", "8: not finite: 'v 1 nan 2'"),
        ("v 1 2\n", "8: a vertex with 2 coordinates; need 3"),
        ("v 1 2 a\n", "8: not numbers: 'v 1 2 a'"),
    ],
)
def test_bad_files_are_refused(tmp_path, text, message):
    path = write(tmp_path / "yarns.obj", text)
    with pytest.raises(InputError) as caught:
        read(path)
    assert str(caught.value) == f"{path}:{message}"


def test_absent_file_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"absent\.obj: cannot be read: No such file or directory"):
        read(tmp_path / "absent.obj")


def test_mutants_are_read_or_refused(tmp_path):
    whole = write(tmp_path / "yarns.obj", "l 1 2 3 4 5\nl -5 -4 -3 -2 -5\n").read_bytes()
    rng = np.random.default_rng(12)
    path = tmp_path / "mutant.obj"
    for _ in range(500):
        mutant = bytearray(whole)
        for _ in range(rng.integers(1, 5)):
            mutant[rng.integers(len(mutant))] = rng.integers(256)
        path.write_bytes(bytes(mutant))
        with contextlib.suppress(InputError):
            read(path)
