"""Reader for the hair files of Mitsuba 0.6 (shapes/hair.cpp) and the curves of Mitsuba 3 (linearcurve).

Binary, little endian: "BINARY_HAIR", uint32 vertex count, then float32 x, y, z of each vertex; a single
infinity before a vertex begins a strand and is not counted. Text: a line `x y z` for each vertex, or `x y z
radius` in Mitsuba 3, and an empty line or one that begins with `#` between strands. No unit and no up axis.
A strand's vertices become control points.
"""

from __future__ import annotations

import struct
from itertools import chain
from pathlib import Path

import numpy as np

from weft.fiber_model.yarns.yarns import MIN_POINTS, YarnSet, refuse_too_many_points
from weft.files.errors import InputError

from .bcc import turned_to_y_up
from .raw_file import (
    begins_with,
    one_radius_each,
    read_bytes,
    read_lines,
    refuse_few_points,
    refuse_other_size,
)

MAGIC = b"BINARY_HAIR"
START = len(MAGIC) + 4
MAX_LINE = 1000
"""Characters of a line of a text file; four numbers need fewer."""


def read_mitsuba_hair(
    path: str | Path,
    *,
    scale_to_mm: float,
    radius_mm: float | None = None,
    up_axis: int = 1,
    type_name: str = "yarn",
) -> YarnSet:
    """Read strands as yarns; `scale_to_mm` is the length of one file unit [mm], `up_axis` 1 (y) or 2 (z).

    `radius_mm` is needed where the file has none, and replaces that of the file where it has.
    """
    path = Path(path)
    strands = _read_binary(path) if begins_with(path, MAGIC) else _read_text(path)
    values = np.concatenate(strands)
    if radius_mm is not None:
        radius = np.full(len(strands), radius_mm)
    elif values.shape[1] == 4:
        offsets = np.cumsum([0] + [len(strand) for strand in strands])
        radius = one_radius_each(values[:, 3] * scale_to_mm, offsets, path)
    else:
        raise InputError("the file holds no radius, so 'radius_mm' must be given", path=path)
    return YarnSet.checked(
        [turned_to_y_up(strand[:, :3], up_axis) * scale_to_mm for strand in strands],
        radius=radius.tolist(),
        type_names=(type_name,),
        source=path,
    )


def _read_binary(path: Path) -> list[np.ndarray]:
    """Vertices of each strand, shape [n, 3]."""
    data = read_bytes(path)
    if len(data) < START:
        what = f"the file ends after {len(data)} bytes, within its {START}-byte header"
        raise InputError(what, path=path, place=f"byte {len(data)}")
    (vertex_count,) = struct.unpack_from("<I", data, len(MAGIC))
    whole = (len(data) - START) // 4
    values = np.frombuffer(data, "<f4", count=whole, offset=START)
    begins = np.flatnonzero(np.isinf(values))
    what = f"{len(begins)} strands of {vertex_count} vertices"
    refuse_other_size(data, START + 4 * len(begins) + 12 * vertex_count, what, path, place="byte 11")
    refuse_too_many_points(vertex_count, "the file", path=path)
    bad = np.isnan(values)
    if bad.any():
        place = f"byte {START + 4 * np.argmax(bad)}"
        raise InputError("a coordinate is not a number", path=path, place=place)
    if not len(begins) or begins[0] != 0:
        begins = np.concatenate([[-1], begins])  # the first strand needs no mark
    strands = []
    for yarn, (begin, end) in enumerate(zip(begins, [*begins[1:], whole], strict=True)):
        place = f"byte {START + 4 * (begin + 1)}"
        if (end - begin - 1) % 3:
            what = f"yarn {yarn} has {end - begin - 1} coordinates, which is no multiple of 3"
            raise InputError(what, path=path, place=place)
        refuse_few_points((end - begin - 1) // 3, yarn, MIN_POINTS, path, place=place)
        strands.append(values[begin + 1 : end].reshape(-1, 3).astype(np.float64))
    return strands


def _read_text(path: Path) -> list[np.ndarray]:
    """Vertices of each strand, shape [n, 3] or, with their radii, [n, 4]; alike for all strands."""
    strands: list[np.ndarray] = []
    rows: list[list[float]] = []
    columns, first_line = 0, 1
    for number, text in chain(read_lines(path), [(0, "")]):
        line = text.strip()
        if line and not line.startswith("#"):
            if not rows:
                first_line = number
            rows.append(_vertex(line, path, number))
            columns = columns or len(rows[0])
            if len(rows[-1]) != columns:
                what = f"{len(rows[-1])} numbers, but {columns} before this line"
                raise InputError(what, path=path, place=number)
        elif rows:
            refuse_few_points(len(rows), len(strands), MIN_POINTS, path, place=first_line)
            strands.append(np.array(rows))
            rows = []
    if not strands:
        raise InputError("no strands in this file", path=path)
    return strands


def _vertex(line: str, path: Path, number: int) -> list[float]:
    words = line[:MAX_LINE].split()
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) not in (3, 4) or not np.isfinite(values).all():
        shown = line[:60].encode("ascii", "backslashreplace").decode()
        what = f"'{shown}' is not three coordinates, or three and a radius"
        raise InputError(what, path=path, place=number)
    return values
