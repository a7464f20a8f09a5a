"""The .bcc reader: what is written comes back; what is damaged is refused with its byte."""

import contextlib
import struct

import numpy as np
import pytest

from weft.fiber_model.yarns.formats.bcc import read_bcc
from weft.files.errors import InputError

HEADER_BYTES = 64


def bcc_bytes(curves, closed, *, kind=b"C0", up=1, dimensions=3, magic=b"BCC", points=None, format_=0x44):
    counts = [len(curve) for curve in curves]
    total = sum(counts) if points is None else points
    header = struct.pack(
        "<3sB2sBBQQ40s", magic, format_, kind, dimensions, up, len(curves), total, b"made by a test"
    )
    body = b"".join(
        struct.pack("<i", -len(curve) if loop else len(curve)) + np.asarray(curve, "<f4").tobytes()
        for curve, loop in zip(curves, closed, strict=True)
    )
    return header + body


@pytest.fixture
def curves():
    rng = np.random.default_rng(5)
    return [rng.normal(size=(count, 3)).astype(np.float32) for count in (5, 9, 4)]


CLOSED = [False, True, False]


@pytest.mark.parametrize("kind", [b"C0", b"PL"])
def test_written_curves_are_read_back(tmp_path, curves, kind):
    path = tmp_path / "yarns.bcc"
    path.write_bytes(bcc_bytes(curves, CLOSED, kind=kind))
    yarns = read_bcc(path, scale_to_mm=10.0, radius_mm=0.6, type_name="wool")
    assert yarns.closed.tolist() == CLOSED
    assert yarns.radius.tolist() == [0.6] * 3
    assert yarns.type_names == ("wool",)
    for index, curve in enumerate(curves):
        assert np.array_equal(yarns.yarn(index), curve.astype(np.float64) * 10.0)


def test_z_up_files_are_turned_to_y_up(tmp_path, curves):
    path = tmp_path / "yarns.bcc"
    path.write_bytes(bcc_bytes(curves, CLOSED, up=2))
    yarns = read_bcc(path, scale_to_mm=1.0, radius_mm=1.0)
    x, y, z = curves[0].astype(np.float64).T
    assert np.array_equal(yarns.yarn(0), np.stack([x, z, -y], axis=1))


def spoil(curves, value):
    curves = [curve.copy() for curve in curves]
    curves[1][2] = (1.5, value, -2.0)
    return curves


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda c: b"", "byte 0: not a .bcc file: it does not begin with 'BCC'"),
        (
            lambda c: bcc_bytes(c, CLOSED, magic=b"BCD"),
            "byte 0: not a .bcc file: it does not begin with 'BCC'",
        ),
        (
            lambda c: bcc_bytes(c, CLOSED)[:40],
            "byte 40: the file ends after 40 bytes, within its 64-byte header",
        ),
        (
            lambda c: bcc_bytes(c, CLOSED, format_=0x88),
            "byte 3: number format 0x88; only 0x44 (4-byte integers and floats) can be read",
        ),
        (
            lambda c: bcc_bytes(c, CLOSED, kind=b"X1"),
            "byte 4: curve type 'X1'; only 'C0' and 'PL' can be read",
        ),
        (lambda c: bcc_bytes(c, CLOSED, dimensions=2), "byte 6: 2 dimensions; need 3"),
        (lambda c: bcc_bytes(c, CLOSED, up=0), "byte 7: up axis 0; need 1 (y) or 2 (z)"),
        (
            lambda c: bcc_bytes(c, CLOSED)[:-5],
            "byte 8: 3 curves of 18 points need 292 bytes, but the file has 287. Is it truncated?",
        ),
        (
            lambda c: bcc_bytes(c, CLOSED, points=1 << 60),
            "byte 8: 3 curves of 1152921504606846976 points need 13835058055282163788 bytes, "
            "but the file has 292. Is it truncated?",
        ),
        (
            lambda c: bcc_bytes([c[0], c[1][:1]], [False, False]),
            "byte 128: yarn 1 has 1 control point; a centerline needs at least 4",
        ),
        (
            lambda c: bcc_bytes(spoil(c, np.nan), CLOSED),
            "byte 156: yarn 1, point 2 is not finite: (1.5, nan, -2)",
        ),
        (
            lambda c: bcc_bytes(spoil(c, 1e30), CLOSED),
            "yarn 1, point 2 lies at (1.5, 1e+30, -2) mm, beyond ten kilometers; check the unit",
        ),
    ],
)
def test_damaged_files_are_refused(tmp_path, curves, make, message):
    path = tmp_path / "yarns.bcc"
    path.write_bytes(make(curves))
    with pytest.raises(InputError) as caught:
        read_bcc(path, scale_to_mm=1.0, radius_mm=1.0)
    assert str(caught.value) == f"{path}:{'' if message.startswith('byte') else ' '}{message}"


def test_a_count_beyond_the_file_is_refused(tmp_path, curves):
    data = bytearray(bcc_bytes(curves, CLOSED))
    data[HEADER_BYTES : HEADER_BYTES + 4] = struct.pack("<i", -(2**31))
    path = tmp_path / "yarns.bcc"
    path.write_bytes(bytes(data))
    with pytest.raises(InputError, match="byte 64: yarn 0 announces 2147483648 points, more than the rest"):
        read_bcc(path, scale_to_mm=1.0, radius_mm=1.0)


def test_mutants_are_read_or_refused(tmp_path, curves):
    whole = bcc_bytes(curves, CLOSED)
    path = tmp_path / "yarns.bcc"
    rng = np.random.default_rng(11)
    for _ in range(500):
        mutant = bytearray(whole)
        for _ in range(rng.integers(1, 5)):
            mutant[rng.integers(len(mutant))] = rng.integers(256)
        path.write_bytes(bytes(mutant[: rng.integers(len(mutant))] if rng.random() < 0.2 else mutant))
        with contextlib.suppress(InputError):  # and nothing else
            read_bcc(path, scale_to_mm=1.0, radius_mm=1.0)
