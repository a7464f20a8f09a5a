"""The .bccx reader and the .bcc writer."""

import struct

import numpy as np
import pytest

from tests.fiber_model.yarns.formats.mutants import read_mutants
from weft.fiber_model.yarns.formats.bcc import read_bcc, read_bccx, write_bcc
from weft.fiber_model.yarns.yarns import YarnSet
from weft.files.errors import InputError

RADIUS = 0.25


@pytest.fixture
def yarns():
    rng = np.random.default_rng(8)
    curves = [rng.normal(size=(count, 3)).astype(np.float32) for count in (6, 4, 11)]
    return YarnSet.checked(curves, closed=[False, True, False], radius=RADIUS)


def write_bccx(yarns, path, *, scale_to_mm=1.0):
    """What YarnBall writes: a .bcc with a radius, velocities at rest and rest lengths behind it."""
    write_bcc(yarns, path, scale_to_mm=scale_to_mm)
    rest = np.zeros(4 * yarns.point_count, "<f4").tobytes()
    path.write_bytes(path.read_bytes() + struct.pack("<f", RADIUS / scale_to_mm) + rest)


def test_bcc_written_here_is_read_back(tmp_path, yarns):
    write_bcc(yarns, tmp_path / "y.bcc", scale_to_mm=0.5)  # a power of two, so that float32 stays exact
    again = read_bcc(tmp_path / "y.bcc", scale_to_mm=0.5, radius_mm=RADIUS)
    assert np.array_equal(again.points, yarns.points)
    assert np.array_equal(again.offsets, yarns.offsets)
    assert np.array_equal(again.closed, yarns.closed)


def test_bccx_is_read_back_with_its_radius(tmp_path, yarns):
    write_bccx(yarns, tmp_path / "y.bccx", scale_to_mm=0.5)
    again = read_bccx(tmp_path / "y.bccx", scale_to_mm=0.5)
    assert np.array_equal(again.points, yarns.points)
    assert np.array_equal(again.closed, yarns.closed)
    assert again.radius.tolist() == [RADIUS] * 3
    assert read_bccx(tmp_path / "y.bccx", scale_to_mm=0.5, radius_mm=0.7).radius.tolist() == [0.7] * 3


def test_a_bcc_is_no_bccx_and_the_reverse(tmp_path, yarns):
    write_bcc(yarns, tmp_path / "y.bcc")
    with pytest.raises(InputError, match="3 curves of 21 points need 668 bytes, but the file has 328"):
        read_bccx(tmp_path / "y.bcc", scale_to_mm=1.0)
    write_bccx(yarns, tmp_path / "y.bccx")
    with pytest.raises(InputError, match="3 curves of 21 points need 328 bytes, but the file has 668"):
        read_bcc(tmp_path / "y.bccx", scale_to_mm=1.0, radius_mm=1.0)


def test_mutants_are_read_or_refused(tmp_path, yarns):
    write_bccx(yarns, tmp_path / "y.bccx")
    whole = (tmp_path / "y.bccx").read_bytes()
    read_mutants(lambda path: read_bccx(path, scale_to_mm=1.0), whole, tmp_path / "m.bccx")
