"""Numbers out of binary files of a known size: checked before anything is allocated."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from weft.files.errors import InputError


def file_size(path: Path) -> int:
    """Bytes of a file. Raises `InputError` where there is none."""
    try:
        if path.is_dir():
            raise InputError("is a folder; give a file", path=path)
        return path.stat().st_size
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", path=path) from None


def refuse_other_size(path: Path, needed: int, what: str) -> None:
    """Raise unless the file has just so many bytes; `what` says what needs them."""
    found = file_size(path)
    if found != needed:
        hint = "Is it truncated?" if found < needed else "Is it another format?"
        raise InputError(f"{what} has {needed} bytes, this file {found}", path=path, hint=hint)


def read_bytes(path: Path, count: int = -1) -> bytes:
    """The first `count` bytes, or all; fewer where the file is shorter."""
    try:
        with open(path, "rb") as file:
            return file.read(count)
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", path=path) from None


def read_doubles(path: Path, count: int, *, start: int = 0) -> np.ndarray:
    """`count` little-endian float64 from byte `start`, all of them finite. Shape [count]."""
    try:
        numbers = np.fromfile(path, dtype="<f8", count=count, offset=start)
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", path=path) from None
    finite = np.isfinite(numbers)
    if len(numbers) != count or not finite.all():
        at = start + 8 * int(np.argmin(finite)) if len(numbers) == count else start + 8 * len(numbers)
        raise InputError("found a number that is not finite", path=path, place=f"byte {at}")
    return numbers
