"""Mitsuba's hair, binary and text."""

import struct

import numpy as np
import pytest

from tests.fiber_model.yarns.formats.mutants import read_mutants
from weft.fiber_model.yarns.formats.mitsuba_hair import read_mitsuba_hair
from weft.files.errors import InputError

INFINITY = struct.pack("<f", np.inf)


def binary(strands, *, first_marked=True, vertices=None):
    count = sum(len(strand) for strand in strands) if vertices is None else vertices
    parts = [strand.astype("<f4").tobytes() for strand in strands]
    body = (INFINITY if first_marked else b"") + INFINITY.join(parts)
    return b"BINARY_HAIR" + struct.pack("<I", count) + body


def text(strands, *, radius=None, between="\n"):
    lines = []
    for k, strand in enumerate(strands):
        end = "" if radius is None else f" {radius[k]!r}"
        lines.append("".join(" ".join(repr(float(c)) for c in point) + end + "\n" for point in strand))
    return between.join(lines).encode()


@pytest.fixture
def strands():
    rng = np.random.default_rng(2)
    return [rng.normal(size=(count, 3)).astype(np.float32) for count in (5, 9, 4)]


@pytest.mark.parametrize(
    "make",
    [
        binary,
        lambda s: binary(s, first_marked=False),
        text,
        lambda s: text(s, between="# next\n\n"),
    ],
)
def test_strands_are_read_back(tmp_path, strands, make):
    (tmp_path / "s.mitshair").write_bytes(make(strands))
    yarns = read_mitsuba_hair(tmp_path / "s.mitshair", scale_to_mm=2.0, radius_mm=0.1)
    for yarn, strand in enumerate(strands):
        assert np.array_equal(yarns.yarn(yarn), 2.0 * strand.astype(np.float64))
    assert yarns.radius.tolist() == [0.1] * 3


def test_the_radii_of_mitsuba_3_are_read(tmp_path, strands):
    (tmp_path / "s.txt").write_bytes(text(strands, radius=[0.1, 0.2, 0.3]))
    assert read_mitsuba_hair(tmp_path / "s.txt", scale_to_mm=2.0).radius.tolist() == [0.2, 0.4, 0.6]


@pytest.mark.parametrize("make", [binary, text])
def test_a_file_without_radius_needs_one(tmp_path, strands, make):
    (tmp_path / "s.hair").write_bytes(make(strands))
    with pytest.raises(InputError, match="the file holds no radius, so 'radius_mm' must be given"):
        read_mitsuba_hair(tmp_path / "s.hair", scale_to_mm=2.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda s: binary(s)[:13], "byte 13: the file ends after 13 bytes, within its 15-byte header"),
        (
            lambda s: binary(s, vertices=2**32 - 1),
            "byte 11: 3 strands of 4294967295 vertices need 51539607567 bytes, but the file has 243. "
            "Is it truncated?",
        ),
        (
            lambda s: binary([s[0], np.full((4, 3), np.nan)]),
            "byte 83: a coordinate is not a number",
        ),
        (lambda s: binary([s[0][:3]]), "byte 19: yarn 0 has 3 control points; a centerline needs at least 4"),
        (lambda s: b"", " no strands in this file"),
        (lambda s: b"0 0 0\n1 2\n", "2: '1 2' is not three coordinates, or three and a radius"),
        (lambda s: b"0 0 0\n1 2 inf\n", "2: '1 2 inf' is not three coordinates, or three and a radius"),
        (lambda s: b"0 0 0\n1 2 3 4\n", "2: 4 numbers, but 3 before this line"),
        (lambda s: b"\n0 0 0\n1 2 3\n", "2: yarn 0 has 2 control points; a centerline needs at least 4"),
    ],
)
def test_damaged_files_are_refused(tmp_path, strands, make, message):
    path = tmp_path / "s.hair"
    path.write_bytes(make(strands))
    with pytest.raises(InputError) as caught:
        read_mitsuba_hair(path, scale_to_mm=1.0, radius_mm=1.0)
    assert str(caught.value) == f"{path}:{message}"


@pytest.mark.parametrize("make", [binary, text])
def test_mutants_are_read_or_refused(tmp_path, strands, make):
    def read(path):
        return read_mitsuba_hair(path, scale_to_mm=1.0, radius_mm=0.1)

    read_mutants(read, make(strands), tmp_path / "m.hair")
