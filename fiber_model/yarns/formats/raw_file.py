"""What the readers of binary and text files share: bytes within bounds, and errors with their place."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from weft.files.errors import InputError

MAX_FILE_BYTES = 4 << 30


def read_bytes(path: Path) -> bytes:
    """The whole file, at most 4 GiB."""
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise InputError("over 4 GiB; not a file of yarns", path=path)
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", path=path) from None


def begins_with(path: Path, magic: bytes) -> bool:
    """Whether these are the first bytes of the file."""
    try:
        with open(path, "rb") as file:
            return file.read(len(magic)) == magic
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", path=path) from None


def read_lines(path: Path) -> Iterator[tuple[int, str]]:
    """Number and text of each line, counted from 1."""
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise InputError("over 4 GiB; not a file of yarns", path=path)
        with open(path, encoding="utf-8", errors="replace") as file:
            yield from enumerate(file, start=1)
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", path=path) from None


def refuse_other_size(data: bytes, needed: int, what: str, path: Path, *, place: str) -> None:
    """Raise unless the file has just the bytes that its header announces; `what` names those."""
    if len(data) != needed:
        found = f"{what} need {needed} bytes, but the file has {len(data)}"
        raise InputError(f"{found}. Is it truncated?", path=path, place=place)


def refuse_not_finite(curve: np.ndarray, yarn: int, start: int, path: Path) -> None:
    """Raise where a coordinate of the yarn's float32 points, which begin at byte `start`, is no number."""
    bad = ~np.isfinite(curve).all(axis=1)
    if bad.any():
        point = int(np.argmax(bad))
        coordinates = ", ".join(f"{value:g}" for value in curve[point])
        what = f"yarn {yarn}, point {point} is not finite: ({coordinates})"
        raise InputError(what, path=path, place=f"byte {start + 12 * point}")


def refuse_few_points(
    count: int, yarn: int, fewest: int, path: Path, *, place: str | int = "", kind: str = "centerline"
) -> None:
    """Raise where a yarn has too few control points."""
    if count < fewest:
        plural = "" if count == 1 else "s"
        what = f"yarn {yarn} has {count} control point{plural}; a {kind} needs at least {fewest}"
        raise InputError(what, path=path, place=place)


def one_radius_each(radius: np.ndarray, offsets: np.ndarray, path: Path) -> np.ndarray:
    """The radius of each yarn from those at its points, which must agree; shape [yarn_count]."""
    low, high = np.minimum.reduceat(radius, offsets[:-1]), np.maximum.reduceat(radius, offsets[:-1])
    uneven = ~(high - low <= 1e-5 * high)
    if uneven.any():
        yarn = int(np.argmax(uneven))
        what = f"yarn {yarn} is {low[yarn]:g} to {high[yarn]:g} mm in radius along its length"
        raise InputError(f"{what}; a yarn has one radius, so give 'radius_mm'", path=path)
    return radius[offsets[:-1]]
