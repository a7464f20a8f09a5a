"""Tensor files of Mitsuba and of the RGL material database: named arrays behind one header.

"tensor_file\\0", version 1.0, number of fields (u32); for each field the length of its name (u16), name,
number of dimensions (u16), type (u8), offset in the file (u64), shape (u64 each). Read by powitacq.inl
(rgl-epfl/brdf-loader) and written by mitsuba.tensor_io, whose layout, data aligned to 8 bytes, is ours.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from weft.files.atomic import atomic_write
from weft.files.errors import InputError

from .binary_file import file_size, read_bytes

MAGIC = b"tensor_file\0"
TYPES = ("u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f2", "f4", "f8")
"""numpy's names of the types, which are numbered from 1."""
ALIGNMENT = 8
MAX_FILE_BYTES = 4 << 30
MAX_FIELDS = 1000
MAX_DIMENSIONS = 16


class _Cursor:
    """Reads the header piece by piece; says where the file ends too early."""

    def __init__(self, data: bytes, path: Path) -> None:
        self.data, self.path, self.at = data, path, 0

    def take(self, count: int) -> bytes:
        if self.at + count > len(self.data):
            what = f"the file ends after {len(self.data)} bytes, within its header. Is it truncated?"
            raise InputError(what, path=self.path, place=f"byte {self.at}")
        self.at += count
        return self.data[self.at - count : self.at]

    def number(self, kind: str) -> int:
        return int(struct.unpack(f"<{kind}", self.take(struct.calcsize(kind)))[0])


def read_tensor_file(path: str | Path) -> dict[str, NDArray]:
    """All fields in the order of the file, read-only. Raises `InputError` with the byte of what is wrong."""
    path = Path(path)
    if file_size(path) > MAX_FILE_BYTES:
        raise InputError("over 4 GiB; not a file of measurements", path=path)
    cursor = _Cursor(read_bytes(path), path)
    if cursor.data[: len(MAGIC)] != MAGIC:
        what = "not a tensor file: it does not begin with 'tensor_file'"
        raise InputError(what, path=path, place="byte 0")
    cursor.take(len(MAGIC))
    version = tuple(cursor.take(2))
    if version != (1, 0):
        what = f"tensor file of version {version[0]}.{version[1]}; only 1.0 can be read"
        raise InputError(what, path=path, place=f"byte {cursor.at - 2}")
    count = cursor.number("I")
    if count > MAX_FIELDS:
        raise InputError(f"{count} fields; a tensor file has a few", path=path, place=f"byte {cursor.at - 4}")
    fields: dict[str, NDArray] = {}
    for _ in range(count):
        begin = cursor.at
        name, array = _field(cursor)
        if name in fields:
            raise InputError(f"field '{name}' stands twice", path=path, place=f"byte {begin}")
        fields[name] = array
    return fields


def _field(cursor: _Cursor) -> tuple[str, NDArray]:
    """Name and values of the field that the header describes next; a view, no copy."""
    begin = cursor.at
    name = cursor.take(cursor.number("H")).decode("ascii", "backslashreplace")
    name = "".join(letter if letter.isprintable() else "?" for letter in name)[:60]
    dimensions, kind, offset = cursor.number("H"), cursor.number("B"), cursor.number("Q")
    what = ""
    if dimensions > MAX_DIMENSIONS:
        what = f"field '{name}' has {dimensions} dimensions"
    elif not 1 <= kind <= len(TYPES):
        what = f"field '{name}' has the unknown type {kind}; there are 1 to {len(TYPES)}"
    else:
        shape = tuple(cursor.number("Q") for _ in range(dimensions))
        dtype = np.dtype(f"<{TYPES[kind - 1]}")
        size = math.prod(shape) * dtype.itemsize
        if offset + size > len(cursor.data):
            what = f"field '{name}' would end at byte {offset + size}, the file at {len(cursor.data)}"
    if what:
        raise InputError(what, path=cursor.path, place=f"byte {begin}")
    flat = np.frombuffer(cursor.data, dtype=dtype, count=math.prod(shape), offset=offset if size else 0)
    return name, flat.reshape(shape)


def write_tensor_file(fields: Mapping[str, NDArray], path: str | Path) -> None:
    """Write the fields in order. What `read_tensor_file` read is written back bit for bit."""
    arrays = {name.encode(): np.ascontiguousarray(array) for name, array in fields.items()}
    header_bytes = len(MAGIC) + 6 + sum(13 + len(name) + 8 * array.ndim for name, array in arrays.items())
    header = MAGIC + struct.pack("<BBI", 1, 0, len(arrays))
    at = header_bytes
    for name, array in arrays.items():
        at = -(-at // ALIGNMENT) * ALIGNMENT
        kind = TYPES.index(array.dtype.str[1:]) + 1
        header += struct.pack("<H", len(name)) + name
        header += struct.pack(f"<HBQ{array.ndim}Q", array.ndim, kind, at, *array.shape)
        at += array.nbytes
    with atomic_write(path) as temporary, open(temporary, "wb") as file:
        file.write(header)
        for array in arrays.values():
            file.write(bytes(-file.tell() % ALIGNMENT))
            file.write(array.astype(array.dtype.newbyteorder("<"), copy=False).tobytes())
