"""Tensor files: bit for bit, also against Mitsuba's; what is damaged is refused with its byte."""

import struct

import numpy as np
import pytest

from weft.files.errors import InputError
from weft.files.measured.tensor_file import TYPES, read_tensor_file, write_tensor_file


@pytest.fixture
def fields():
    rng = np.random.default_rng(5)
    arrays = {f"of_{name}": (100 * rng.random((2, 3, 5))).astype(name) for name in TYPES}
    return {"nothing": np.zeros((0, 3), "f4")} | arrays | {"words": np.frombuffer(b"synthetic", np.uint8)}


def test_files_round_trip_bit_for_bit(tmp_path, fields):
    one, two = tmp_path / "one.bsdf", tmp_path / "two.bsdf"
    write_tensor_file(fields, one)
    found = read_tensor_file(one)
    assert list(found) == list(fields)
    for name, array in fields.items():
        assert found[name].dtype == array.dtype
        assert found[name].shape == array.shape
        assert found[name].tobytes() == array.tobytes()
    write_tensor_file(found, two)
    assert one.read_bytes() == two.read_bytes()


def test_our_files_are_mitsubas_byte_for_byte(tmp_path, fields):
    tensor_io = pytest.importorskip("mitsuba").tensor_io
    ours, theirs = tmp_path / "ours.bsdf", tmp_path / "theirs.bsdf"
    write_tensor_file(fields, ours)
    tensor_io.write(str(theirs), **fields)
    assert ours.read_bytes() == theirs.read_bytes()


def simple():
    """One field 'a', two float32: name at 18, shape at 32, data at 40."""
    head = b"tensor_file\0" + struct.pack("<BBI", 1, 0, 1) + struct.pack("<H", 1) + b"a"
    return head + struct.pack("<HBQQ", 1, 10, 40, 2) + struct.pack("<2f", 1.0, 2.0)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda d: b"tensor" + d, "byte 0: not a tensor file: it does not begin with 'tensor_file'"),
        (lambda d: b"", "byte 0: not a tensor file: it does not begin with 'tensor_file'"),
        (lambda d: d[:12] + b"\2" + d[13:], "byte 12: tensor file of version 2.0; only 1.0 can be read"),
        (lambda d: d[:14] + b"\xff\xff\0\0" + d[18:], "byte 14: 65535 fields; a tensor file has a few"),
        (lambda d: d[:30], "byte 24: the file ends after 30 bytes, within its header. Is it truncated?"),
        (lambda d: d[:23] + b"\x0c" + d[24:], "byte 18: field 'a' has the unknown type 12; there are"),
        (lambda d: d[:21] + b"\xff\xff" + d[23:], "byte 18: field 'a' has 65535 dimensions"),
        (lambda d: d[:-1], "byte 18: field 'a' would end at byte 48, the file at 47"),
        (
            lambda d: d[:32] + struct.pack("<Q", 2**63) + d[40:],
            f"byte 18: field 'a' would end at byte {2**65 + 40}, the file at 48",
        ),
    ],
)  # fmt: skip
def test_damaged_files_are_refused(tmp_path, spoil, message):
    path = tmp_path / "one.bsdf"
    path.write_bytes(simple())
    assert read_tensor_file(path)["a"].tolist() == [1.0, 2.0]
    path.write_bytes(spoil(simple()))
    with pytest.raises(InputError) as caught:
        read_tensor_file(path)
    assert str(caught.value).startswith(f"{path}:{message}")
