"""The .pyp reader: what is written comes back; what is damaged is refused with its line."""

import contextlib

import numpy as np
import pytest

from weft.fiber_model.yarns.formats.pyp import read_pyp
from weft.files.errors import InputError

TEXT = """*pattern # px py radius num_vertedges
0.01 0.02 0.001 4

*Q # dofs: x y z t
0 0 0 0.1
0.0025 0.001 0 0.2
0.005 0 0.001 0.3
0.0075 -0.001 0 0.4

*E # edges [v0, v1, dx, dy]
0 1 0 0
1 2 0 0
2 3 0 0
3 0 1 0

*RL # rest lengths
0.0026
0.0027
0.0027
0.0026

*RK # rest kappas
0 0
"""


def write(path, text=TEXT):
    path.write_text(text)
    return path


def test_tile_is_read_in_mm(tmp_path):
    tile = read_pyp(write(tmp_path / "tile.pyp"))
    assert tile.period == pytest.approx([10, 20])
    assert tile.radius == pytest.approx(1.0)
    assert tile.points[1] == pytest.approx([2.5, 1, 0])
    assert tile.twist == pytest.approx([0.1, 0.2, 0.3, 0.4])
    assert tile.next_vertex.tolist() == [1, 2, 3, 0]
    assert tile.next_step.tolist() == [[0, 0], [0, 0], [0, 0], [1, 0]]
    assert tile.rest_length == pytest.approx([2.6, 2.7, 2.7, 2.6])
    assert tile.director is None
    assert read_pyp(tmp_path / "tile.pyp", scale_to_mm=100).radius == pytest.approx(0.1)


def test_directors_are_perpendicular_to_the_edges_that_leave(shared_data):
    """What tells that row v of the file's per-edge sections belongs to the edge leaving vertex v."""
    tile = read_pyp(shared_data / "yarn_patterns" / "stockinette.pyp")
    edge = tile.edge_vectors()
    length = np.linalg.norm(edge, axis=1)
    assert np.abs((edge * tile.director).sum(axis=1) / length).max() < 1e-4
    assert length == pytest.approx(tile.rest_length, rel=0.005)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("*E", "*F", "10: unknown section '*F'; known are *pattern, *Q, *E, *RL, *RefD1, *RK, *RT, *RefT"),
        ("*Q", "*E", "10: second section '*E'"),
        (TEXT, "", " no section '*pattern'; a .pyp file needs *pattern, *Q and *E"),
        (TEXT[TEXT.index("*E") :], "", " no section '*E'; a .pyp file needs *pattern, *Q and *E"),
        ("3 0 1 0\n", "", "10: section '*E' has 3 rows; need 4. Is the file truncated?"),
        (
            "0.001 4\n",
            "0.001 40000000\n",
            "4: section '*Q' has 4 rows; need 40000000. Is the file truncated?",
        ),
        (
            "0.001 4\n",
            "0.001 4e18\n",
            " the tile would have 4,000,000,000,000,000,000 control points; at most 100,000,000 fit",
        ),
        (
            "0.001 4\n",
            "0 4\n",
            "2: *pattern needs a positive period, radius and vertex count; found [0.01, 0.02, 0.0, 4.0]",
        ),
        ("0.0025 0.001", "0.0025 nan", "6: not finite: '0.0025 nan 0 0.2'"),
        ("0.0025 0.001", "0.0025 q", "6: not numbers: '0.0025 q 0 0.2'"),
        ("0.0025 0.001 0", "0.0025 0.001", "6: found 3 values in '*Q'; need 4"),
        ("3 0 1 0", "3 7 1 0", "14: edge names vertex 7, but there are 4 (counted from 0)"),
        ("3 0 1 0", "3 1 1 0", "14: yarns meet or branch at this edge"),
        ("3 0 1 0", "3 0 0.5 0", "14: an edge needs two vertices and two small tile steps"),
        ("*pattern", "12 *pattern", "1: found '12' before the first section"),
    ],
)
def test_damaged_files_are_refused(tmp_path, old, new, message):
    path = write(tmp_path / "tile.pyp", TEXT.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        read_pyp(path)
    assert str(caught.value) == f"{path}:{message}"


def test_binary_files_are_refused(tmp_path):
    path = tmp_path / "tile.pyp"
    path.write_bytes(b"*pattern\n\xff\xfe")
    with pytest.raises(InputError, match="byte 9: not a text file"):
        read_pyp(path)


def test_mutants_are_read_or_refused(tmp_path):
    rng = np.random.default_rng(13)
    path = tmp_path / "mutant.pyp"
    for _ in range(500):
        mutant = bytearray(TEXT.encode())
        for _ in range(rng.integers(1, 5)):
            mutant[rng.integers(len(mutant))] = rng.integers(256)
        path.write_bytes(bytes(mutant))
        with contextlib.suppress(InputError):
            read_pyp(path)
