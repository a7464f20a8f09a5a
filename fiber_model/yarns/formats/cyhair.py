"""Reader for .hair, the hair models of Yuksel (cyHairFile.h, cemyuksel.com/research/hairmodels).

128-byte header, little endian: "HAIR", uint32 strand count, point count and arrays present (1 segments, 2
points, 4 thickness, 8 transparency, 16 color, 32 texture coordinates of LuxCore), uint32 default segments,
float32 default thickness, transparency and color (3), 88 bytes of text. Then the arrays: uint16 segments
per strand, float32 points (3), thickness, transparency, color (3), uv (2) per point. Thickness is taken for
the diameter, which the format does not say outright. No unit and no up axis.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from weft.fiber_model.yarns.yarns import MIN_POINTS, YarnSet, refuse_too_many_points
from weft.files.errors import InputError

from .bcc import turned_to_y_up
from .raw_file import one_radius_each, read_bytes, refuse_few_points, refuse_not_finite, refuse_other_size

HEADER = struct.Struct("<4s4I5f88s")
SEGMENTS, POINTS, THICKNESS = 1, 2, 4
BYTES_PER_POINT = {POINTS: 12, THICKNESS: 4, 8: 4, 16: 12, 32: 8}


def read_cyhair(
    path: str | Path,
    *,
    scale_to_mm: float,
    radius_mm: float | None = None,
    up_axis: int = 1,
    type_name: str = "yarn",
) -> YarnSet:
    """Read strands as yarns; `scale_to_mm` is the length of one file unit [mm], `up_axis` 1 (y) or 2 (z).

    The radius is half the file's thickness, which must not vary along a strand, unless `radius_mm` is given.
    """
    path = Path(path)
    data = read_bytes(path)
    strand_count, point_count, arrays, segments, thickness = _read_header(data, path)
    counts = _point_counts(data, strand_count, point_count, arrays, segments, path)
    offsets = np.concatenate([[0], np.cumsum(counts)])
    at = HEADER.size + (2 * strand_count if arrays & SEGMENTS else 0)
    points = np.frombuffer(data, "<f4", count=3 * point_count, offset=at).reshape(-1, 3)
    for yarn, count in enumerate(counts):
        refuse_few_points(int(count), yarn, MIN_POINTS, path)
        refuse_not_finite(points[offsets[yarn] : offsets[yarn + 1]], yarn, at + 12 * int(offsets[yarn]), path)
    if radius_mm is not None:
        radius = np.full(strand_count, radius_mm)
    elif arrays & THICKNESS:
        diameter = np.frombuffer(data, "<f4", count=point_count, offset=at + 12 * point_count)
        radius = one_radius_each(0.5 * scale_to_mm * diameter.astype(np.float64), offsets, path)
    else:
        radius = np.full(strand_count, 0.5 * scale_to_mm * thickness)
    turned = turned_to_y_up(points.astype(np.float64), up_axis) * scale_to_mm
    return YarnSet.checked(
        np.split(turned, offsets[1:-1]),
        radius=radius.tolist(),
        type_names=(type_name,),
        source=path,
    )


def _read_header(data: bytes, path: Path) -> tuple[int, int, int, int, float]:
    """Counts of strands and points, arrays present, default segments and thickness; sizes are right."""
    if data[:4] != b"HAIR":
        raise InputError("not a cyHair file: it does not begin with 'HAIR'", path=path, place="byte 0")
    if len(data) < HEADER.size:
        what = f"the file ends after {len(data)} bytes, within its {HEADER.size}-byte header"
        raise InputError(what, path=path, place=f"byte {len(data)}")
    _, strand_count, point_count, arrays, segments, thickness, *_ = HEADER.unpack_from(data)
    if arrays >= 64 or not arrays & POINTS:
        what = f"arrays 0x{arrays:x}; need points (2), with any of 1, 4, 8, 16 and 32"
        raise InputError(what, path=path, place="byte 12")
    per_point = sum(size for bit, size in BYTES_PER_POINT.items() if arrays & bit)
    needed = HEADER.size + (2 * strand_count if arrays & SEGMENTS else 0) + per_point * point_count
    what = f"{strand_count} strands of {point_count} points"
    refuse_other_size(data, needed, what, path, place="byte 4")
    if not strand_count:
        raise InputError("there are no strands; need at least one", path=path, place="byte 4")
    refuse_too_many_points(point_count, "the file", path=path)
    return strand_count, point_count, arrays, segments, thickness


def _point_counts(
    data: bytes, strand_count: int, point_count: int, arrays: int, segments: int, path: Path
) -> np.ndarray:
    """Points of each strand, int64, shape [strand_count]."""
    total = strand_count * (segments + 1)
    if arrays & SEGMENTS:
        total = int(np.frombuffer(data, "<u2", count=strand_count, offset=HEADER.size).sum(dtype=np.int64))
        total += strand_count
    if total != point_count:
        what = f"the strands have {total} points, but the header says {point_count}"
        raise InputError(what, path=path, place="byte 8")
    if arrays & SEGMENTS:
        return np.frombuffer(data, "<u2", count=strand_count, offset=HEADER.size).astype(np.int64) + 1
    return np.full(strand_count, segments + 1, np.int64)
