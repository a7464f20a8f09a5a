"""The cyHair reader: strands with default and own segments and thickness."""

import struct

import numpy as np
import pytest

from tests.fiber_model.yarns.formats.mutants import read_mutants
from weft.fiber_model.yarns.formats.cyhair import read_cyhair
from weft.files.errors import InputError


def hair_bytes(strands, *, thickness=None, default_thickness=0.5, own_segments=True, extra=0, arrays=None):
    """A .hair file; `extra` adds the arrays of these bits, zeros."""
    count = sum(len(strand) for strand in strands)
    bits = 2 | own_segments | (4 if thickness is not None else 0) | extra
    segments = len(strands[0]) - 1
    header = struct.pack(
        "<4s4I5f88s",
        b"HAIR",
        len(strands),
        count,
        bits if arrays is None else arrays,
        segments,
        default_thickness,
        1.0,
        0.2,
        0.3,
        0.4,
        b"test",
    )
    body = np.array([len(s) - 1 for s in strands], "<u2").tobytes() if own_segments else b""
    body += np.concatenate(strands).astype("<f4").tobytes()
    body += b"" if thickness is None else np.concatenate(thickness).astype("<f4").tobytes()
    for bit, size in ((8, 4), (16, 12), (32, 8)):
        body += bytes(size * count) if extra & bit else b""
    return header + body


@pytest.fixture
def strands():
    rng = np.random.default_rng(2)
    return [rng.normal(size=(count, 3)).astype(np.float32) for count in (5, 9, 4)]


@pytest.mark.parametrize("extra", [0, 8, 16, 32, 56])
def test_strands_are_read_back(tmp_path, strands, extra):
    thickness = [np.full(len(strand), 0.25 * (k + 1)) for k, strand in enumerate(strands)]
    (tmp_path / "s.hair").write_bytes(hair_bytes(strands, thickness=thickness, extra=extra))
    yarns = read_cyhair(tmp_path / "s.hair", scale_to_mm=4.0)
    for yarn, strand in enumerate(strands):
        assert np.array_equal(yarns.yarn(yarn), 4.0 * strand.astype(np.float64))
    assert yarns.radius.tolist() == [0.5, 1.0, 1.5]
    assert not yarns.closed.any()


def test_default_segments_and_thickness_and_z_up(tmp_path, strands):
    strands = [strands[1][:6], strands[1][3:]]
    (tmp_path / "s.hair").write_bytes(hair_bytes(strands, own_segments=False))
    yarns = read_cyhair(tmp_path / "s.hair", scale_to_mm=1.0, up_axis=2)
    assert yarns.radius.tolist() == [0.25, 0.25]
    x, y, z = strands[1].astype(np.float64).T
    assert np.array_equal(yarns.yarn(1), np.stack([x, z, -y], axis=1))


def test_tapered_strands_need_a_radius(tmp_path, strands):
    thickness = [np.linspace(0.2, 0.1, len(strand)) for strand in strands]
    (tmp_path / "s.hair").write_bytes(hair_bytes(strands, thickness=thickness))
    with pytest.raises(
        InputError, match=r"yarn 0 is 0\.05 to 0\.1 mm in radius along its length; .*radius_mm"
    ):
        read_cyhair(tmp_path / "s.hair", scale_to_mm=1.0)
    yarns = read_cyhair(tmp_path / "s.hair", scale_to_mm=1.0, radius_mm=0.3)
    assert yarns.radius.tolist() == [0.3] * 3


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda s: b"HAIL" + hair_bytes(s)[4:], "byte 0: not a cyHair file: it does not begin with 'HAIR'"),
        (
            lambda s: hair_bytes(s)[:100],
            "byte 100: the file ends after 100 bytes, within its 128-byte header",
        ),
        (
            lambda s: hair_bytes(s, arrays=1),
            "byte 12: arrays 0x1; need points (2), with any of 1, 4, 8, 16 and 32",
        ),
        (
            lambda s: hair_bytes(s)[:-4],
            "byte 4: 3 strands of 18 points need 350 bytes, but the file has 346. Is it truncated?",
        ),
        (
            lambda s: hair_bytes(s)[:4] + struct.pack("<I", 2**32 - 1) + hair_bytes(s)[8:],
            "byte 4: 4294967295 strands of 18 points need 8589934934 bytes, but the file has 350. "
            "Is it truncated?",
        ),
        (
            lambda s: hair_bytes(s, own_segments=False),
            "byte 8: the strands have 15 points, but the header says 18",
        ),
        (
            lambda s: hair_bytes([s[0], s[1][:3]]),
            " yarn 1 has 3 control points; a centerline needs at least 4",
        ),
        (
            lambda s: hair_bytes([s[0], s[1] * np.float32(np.nan)]),
            "byte 192: yarn 1, point 0 is not finite: (nan, nan, nan)",
        ),
    ],
)
def test_damaged_files_are_refused(tmp_path, strands, make, message):
    path = tmp_path / "s.hair"
    path.write_bytes(make(strands))
    with pytest.raises(InputError) as caught:
        read_cyhair(path, scale_to_mm=1.0)
    assert str(caught.value) == f"{path}:{message}"


def test_mutants_are_read_or_refused(tmp_path, strands):
    thickness = [np.full(len(strand), 0.25) for strand in strands]
    whole = hair_bytes(strands, thickness=thickness)
    read_mutants(lambda path: read_cyhair(path, scale_to_mm=1.0), whole, tmp_path / "m.hair")
