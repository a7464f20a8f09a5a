"""The .poly reader follows edges in any order."""

from itertools import pairwise

import numpy as np
import pytest

from tests.fiber_model.yarns.formats.mutants import read_mutants
from weft.fiber_model.yarns.formats.poly import read_poly
from weft.files.errors import InputError

POINTS = np.random.default_rng(6).normal(size=(14, 3))
OPEN, LOOP = [3, 0, 7, 9, 2], [4, 1, 12, 5, 8, 6]  # points from 0; 10, 11 and 13 are in no yarn


def poly(edges, *, end="END\n"):
    lines = ["POINTS"] + [f"{k + 1}: {x!r} {y!r} {z!r}" for k, (x, y, z) in enumerate(POINTS.tolist())]
    lines += ["POLYS"] + [f"{k + 1}: " + " ".join(str(i + 1) for i in edge) for k, edge in enumerate(edges)]
    return ("\n".join(lines) + "\n" + end).encode()


def edges():
    pairs = [*pairwise(OPEN), *zip(LOOP, LOOP[1:] + LOOP[:1], strict=True)]
    shuffled = np.random.default_rng(3).permutation(len(pairs))
    return [pairs[k][:: 1 if k % 2 else -1] for k in shuffled]


def read(path, **options):
    return read_poly(path, **({"scale_to_mm": 2.0, "radius_mm": 0.1} | options))


def test_edges_in_any_order_become_yarns(tmp_path):
    (tmp_path / "y.poly").write_bytes(poly(edges()))
    yarns = read(tmp_path / "y.poly")
    assert yarns.closed.tolist() == [False, True]
    assert np.array_equal(yarns.yarn(0), 2.0 * POINTS[OPEN[::-1]])  # from point 2, the first of its ends
    start = LOOP.index(1)
    loops = [(LOOP[start:] + LOOP[:start])[::way] for way in (1, -1)]
    loops[1] = loops[1][-1:] + loops[1][:-1]
    assert any(np.array_equal(yarns.yarn(1), 2.0 * POINTS[loop]) for loop in loops)


def test_a_line_may_join_a_chain(tmp_path):
    (tmp_path / "y.poly").write_bytes(poly([OPEN]))
    assert np.array_equal(read(tmp_path / "y.poly").yarn(0), 2.0 * POINTS[OPEN[::-1]])


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (poly(edges(), end=""), " the file ends without 'END'. Is it truncated?"),
        (poly([]), " no edges ('POLYS') in this file"),
        (poly([[0, 1], [1, 2]]), " yarn 0 has 3 control points; a centerline needs at least 4"),
        (poly([[0, 1, 2, 3], [1, 5]]), "18: yarns meet or branch at this edge"),
        (poly([[0, 1], [1, 0]]), "18: this edge joins a point to itself or stands twice"),
        (poly([[0, 20]]), "17: edge to point 21, which is not in 'POINTS'"),
        (poly([[0]]), "17: an edge needs 'id: i j', ids of points"),
        (b"POINTS\n1: 0 0 nan\n", "2: a point needs 'id: x y z', finite numbers"),
        (b"POINTS\n1: 0 0 0\n1: 0 0 0\n", "3: second point 1"),
        (b"ply\n", "1: found 'ply' before 'POINTS'"),
    ],
)
def test_damaged_files_are_refused(tmp_path, data, message):
    path = tmp_path / "y.poly"
    path.write_bytes(data)
    with pytest.raises(InputError) as caught:
        read(path)
    assert str(caught.value) == f"{path}:{message}"


def test_mutants_are_read_or_refused(tmp_path):
    read_mutants(read, poly(edges()), tmp_path / "m.poly")
