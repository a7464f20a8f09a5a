"""Reader and writer for .bcc, the binary curve collections of Yuksel's yarn models (cyCodeBase), and .bccx.

64-byte header, little endian: "BCC", 0x44 (4-byte integers and floats), "C0" (uniform Catmull-Rom) or "PL"
(polyline), dimensions (3), up axis (1 = y, 2 = z), uint64 curve count, uint64 point count, 40 bytes of
text. Then per curve: int32 n, negative for a loop, and |n| points of three float32. No unit and no radius.

A .bccx file (YarnBall, smobj) goes on with one float32 radius, and for each point three float32 of velocity
and one of rest length, which are not read. smobj's converter adds a point at each open end, in line with
the last two, to guide the curve; here the curve passes through these as well.

The points of a polyline become control points like the others: simulated rods are smooth curves, and their
polylines are samples of them.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from weft.fiber_model.yarns.yarns import MIN_POINTS, YarnSet, refuse_too_many_points
from weft.files.atomic import atomic_write
from weft.files.errors import InputError

from .raw_file import read_bytes, refuse_few_points, refuse_not_finite, refuse_other_size

HEADER = struct.Struct("<3sB2sBBQQ40s")
CURVE_TYPES = (b"C0", b"PL")


@dataclass(frozen=True)
class _Curves:
    """Curves with y up, in the unit of the file, and what the file holds after them."""

    points: list[np.ndarray]
    closed: list[bool]
    rest: bytes


def read_bcc(path: str | Path, *, scale_to_mm: float, radius_mm: float, type_name: str = "yarn") -> YarnSet:
    """Read yarns; `scale_to_mm` is the length of one file unit [mm]. A z-up file is turned to y up."""
    curves = _read_curves(Path(path))
    return _yarns(curves, scale_to_mm, radius_mm, type_name, path)


def read_bccx(
    path: str | Path, *, scale_to_mm: float, radius_mm: float | None = None, type_name: str = "yarn"
) -> YarnSet:
    """Read yarns like `read_bcc`, and their radius unless `radius_mm` is given in its place."""
    curves = _read_curves(Path(path), rest_bytes=4, rest_bytes_per_point=16)
    if radius_mm is None:
        radius_mm = float(np.frombuffer(curves.rest, "<f4", count=1)[0]) * scale_to_mm
    return _yarns(curves, scale_to_mm, radius_mm, type_name, path)


def write_bcc(yarns: YarnSet, path: str | Path, *, scale_to_mm: float = 1.0) -> None:
    """Write centerlines, y up; `scale_to_mm` is the length of one file unit [mm].

    The format holds float32 coordinates and neither radius nor type, twist or (u, v).
    """
    header = HEADER.pack(b"BCC", 0x44, b"C0", 3, 1, yarns.yarn_count, yarns.point_count, b"written by weft")
    counts = np.where(yarns.closed, -yarns.point_counts, yarns.point_counts).astype("<i4")
    with atomic_write(path) as temporary, open(temporary, "wb") as file:
        file.write(header)
        for yarn, count in enumerate(counts):
            file.write(count.tobytes() + (yarns.yarn(yarn) / scale_to_mm).astype("<f4").tobytes())


def _yarns(
    curves: _Curves, scale_to_mm: float, radius_mm: float, type_name: str, path: str | Path
) -> YarnSet:
    return YarnSet.checked(
        [points * scale_to_mm for points in curves.points],
        closed=curves.closed,
        radius=radius_mm,
        type_names=(type_name,),
        source=path,
    )


def _read_curves(path: Path, *, rest_bytes: int = 0, rest_bytes_per_point: int = 0) -> _Curves:
    """All curves of the file, once the counts in it agree with its size."""
    data = read_bytes(path)
    up_axis, curve_count, point_count = _read_header(data, path)
    end = HEADER.size + 4 * curve_count + 12 * point_count
    what = f"{curve_count} curves of {point_count} points"
    refuse_other_size(data, end + rest_bytes + rest_bytes_per_point * point_count, what, path, place="byte 8")
    refuse_too_many_points(point_count, "the file", path=path)
    first, counts, closed = _find_curves(data[HEADER.size : end], curve_count, point_count, path)
    values = np.frombuffer(data[HEADER.size : end], dtype="<f4")
    curves = []
    for yarn, (begin, count) in enumerate(zip(first, counts, strict=True)):
        curve = values[begin : begin + 3 * count].reshape(-1, 3).astype(np.float64)
        refuse_not_finite(curve, yarn, HEADER.size + 4 * int(begin), path)
        curves.append(turned_to_y_up(curve, up_axis))
    return _Curves(curves, closed.tolist(), data[end:])


def turned_to_y_up(points: np.ndarray, up_axis: int) -> np.ndarray:
    """Points with axis `up_axis` (1 = y, 2 = z) up, turned so that y is up; right-handed as before."""
    return points if up_axis == 1 else np.stack([points[:, 0], points[:, 2], -points[:, 1]], axis=1)


def _read_header(data: bytes, path: Path) -> tuple[int, int, int]:
    """Up axis, number of curves and of points."""
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
        refuse_few_points(count, curve, MIN_POINTS, path, place=place)
        if at + 1 + 3 * count > len(words):
            what = f"yarn {curve} announces {count} points, more than the rest of the file holds"
            raise InputError(what, path=path, place=place)
        first[curve], counts[curve], closed[curve] = at + 1, count, number < 0
        at += 1 + 3 * count
    if counts.sum() != point_count:
        what = f"the curves have {counts.sum()} points, but the header says {point_count}"
        raise InputError(what, path=path, place="byte 16")
    return first, counts, closed
