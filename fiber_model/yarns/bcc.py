"""Reader for .bcc, the binary curve collections of Yuksel's yarn models (cemyuksel.com/cyCodeBase).

64-byte header, little endian: "BCC", 0x44 (4-byte integers and floats), "C0" (uniform Catmull-Rom) or "PL"
(polyline), dimensions (3), up axis (1 = y, 2 = z), uint64 curve count, uint64 point count, 40 bytes of text.
Then per curve: int32 n, negative for a loop, and |n| points of three float32. No unit and no radius.

The points of a polyline become control points like the others: simulated rods are smooth curves, and their
polylines are samples of them.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from weft.files.errors import InputError

from .yarns import MIN_POINTS, YarnSet, refuse_too_many_points

HEADER = struct.Struct("<3sB2sBBQQ40s")
CURVE_TYPES = (b"C0", b"PL")


def read_bcc(path: str | Path, *, scale_to_mm: float, radius_mm: float, type_name: str = "yarn") -> YarnSet:
    """Read yarns; `scale_to_mm` is the length of one file unit [mm]. A z-up file is turned to y up."""
    path = Path(path)
    try:
        with open(path, "rb") as file:
            up_axis, curve_count, point_count = _read_header(file.read(HEADER.size), path)
            data = file.read()
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", path=path) from None
    first, counts, closed = _find_curves(data, curve_count, point_count, path)
    values = np.frombuffer(data, dtype="<f4")
    curves = [
        values[begin : begin + 3 * count].reshape(-1, 3).astype(np.float64)
        for begin, count in zip(first, counts, strict=True)
    ]
    for yarn, (curve, begin) in enumerate(zip(curves, first, strict=True)):
        _refuse_not_finite(curve, yarn, HEADER.size + 4 * int(begin), path)
    return YarnSet.checked(
        [turned_to_y_up(curve, up_axis) * scale_to_mm for curve in curves],
        closed=closed.tolist(),
        radius=radius_mm,
        type_names=(type_name,),
        source=path,
    )


def turned_to_y_up(points: np.ndarray, up_axis: int) -> np.ndarray:
    """Points with axis `up_axis` (1 = y, 2 = z) up, turned so that y is up; right-handed as before."""
    return points if up_axis == 1 else np.stack([points[:, 0], points[:, 2], -points[:, 1]], axis=1)


def _read_header(data: bytes, path: Path) -> tuple[int, int, int]:
    """Up axis, number of curves and of points, after the sizes have been held against the file's size."""
    if data[:3] != b"BCC":
        raise InputError("not a .bcc file: it does not begin with 'BCC'", path=path, place="byte 0")
    if len(data) < HEADER.size:
        what = f"the file ends after {len(data)} bytes, within its {HEADER.size}-byte header"
        raise InputError(what, path=path, place=f"byte {len(data)}")
    _, byte_count, kind, dimensions, up_axis, curve_count, point_count, _ = HEADER.unpack_from(data)
    if byte_count != 0x44:
        what = f"number format 0x{byte_count:02x}; only 0x44 (4-byte integers and floats) can be read"
        raise InputError(what, path=path, place="byte 3")
    if kind not in CURVE_TYPES:
        shown = kind.decode("ascii", "backslashreplace")
        raise InputError(f"curve type '{shown}'; only 'C0' and 'PL' can be read", path=path, place="byte 4")
    if dimensions != 3:
        raise InputError(f"{dimensions} dimensions; need 3", path=path, place="byte 6")
    if up_axis not in (1, 2):
        raise InputError(f"up axis {up_axis}; need 1 (y) or 2 (z)", path=path, place="byte 7")
    needed = HEADER.size + 4 * curve_count + 12 * point_count
    size = path.stat().st_size
    if needed != size:
        what = f"{curve_count} curves of {point_count} points need {needed} bytes, but the file has {size}"
        raise InputError(f"{what}. Is it truncated?", path=path, place="byte 8")
    refuse_too_many_points(point_count, "the file", path=path)
    return up_axis, curve_count, point_count


def _find_curves(
    data: bytes, curve_count: int, point_count: int, path: Path
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Per curve: index of its first float after the header, number of points, whether it is a loop."""
    words = np.frombuffer(data, dtype="<i4")
    first, counts = np.empty(curve_count, np.int64), np.empty(curve_count, np.int64)
    closed = np.empty(curve_count, bool)
    at = 0
    for curve in range(curve_count):
        place = f"byte {HEADER.size + 4 * at}"
        if at >= len(words):
            raise InputError(f"the file ends before curve {curve} of {curve_count}", path=path, place=place)
        number = int(words[at])
        count = abs(number)
        if count < MIN_POINTS:
            plural = "s" * (count != 1)
            what = f"yarn {curve} has {count} control point{plural}; a centerline needs at least {MIN_POINTS}"
            raise InputError(what, path=path, place=place)
        if at + 1 + 3 * count > len(words):
            what = f"yarn {curve} announces {count} points, more than the rest of the file holds"
            raise InputError(what, path=path, place=place)
        first[curve], counts[curve], closed[curve] = at + 1, count, number < 0
        at += 1 + 3 * count
    if counts.sum() != point_count:
        what = f"the curves have {counts.sum()} points, but the header says {point_count}"
        raise InputError(what, path=path, place="byte 16")
    return first, counts, closed


def _refuse_not_finite(curve: np.ndarray, yarn: int, start: int, path: Path) -> None:
    bad = ~np.isfinite(curve).all(axis=1)
    if bad.any():
        point = int(np.argmax(bad))
        coordinates = ", ".join(f"{value:g}" for value in curve[point])
        what = f"yarn {yarn}, point {point} is not finite: ({coordinates})"
        raise InputError(what, path=path, place=f"byte {start + 12 * point}")
