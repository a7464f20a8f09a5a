"""Reader for yarns in Wavefront OBJ files: `l` polylines through `v` vertices; other statements are skipped.

Vertices count from 1, negative ones from the latest. A polyline whose last vertex is its first is a loop.
Lines that begin where the one before ended are one yarn, as some programs write every segment by itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from weft.fiber_model.yarns.yarns import MIN_POINTS, YarnSet
from weft.files.errors import InputError

from .bcc import turned_to_y_up

MAX_FILE_BYTES = 4 << 30


@dataclass(frozen=True)
class _Polyline:
    """Vertices, counted from 0, and the line of the file where they begin."""

    line: int
    vertices: list[int]


def read_obj_lines(
    path: str | Path,
    *,
    scale_to_mm: float,
    radius_mm: float,
    up_axis: int = 1,
    type_name: str = "yarn",
) -> YarnSet:
    """Read yarns; `scale_to_mm` is the length of one file unit [mm], `up_axis` 1 (y) or 2 (z)."""
    path = Path(path)
    vertices, polylines = _read_statements(path)
    if not polylines:
        raise InputError("no polylines ('l' statements) in this file", path=path)
    points = turned_to_y_up(np.array(vertices).reshape(-1, 3), up_axis) * scale_to_mm
    curves, closed = [], []
    for yarn, polyline in enumerate(polylines):
        loop = len(polyline.vertices) > 1 and polyline.vertices[0] == polyline.vertices[-1]
        index = polyline.vertices[:-1] if loop else polyline.vertices
        if len(index) < MIN_POINTS:
            plural = "s" * (len(index) != 1)
            what = f"yarn {yarn} has {len(index)} control point{plural}"
            needed = f"a centerline needs at least {MIN_POINTS}"
            raise InputError(f"{what}; {needed}", path=path, place=polyline.line)
        curves.append(points[index])
        closed.append(loop)
    return YarnSet.checked(curves, closed=closed, radius=radius_mm, type_names=(type_name,), source=path)


def _read_statements(path: Path) -> tuple[list[tuple[float, ...]], list[_Polyline]]:
    """All vertices and all polylines of the file."""
    vertices: list[tuple[float, ...]] = []
    polylines: list[_Polyline] = []
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise InputError("over 4 GiB; not a file of yarns", path=path)
        with open(path, encoding="utf-8", errors="replace") as file:
            for number, line in enumerate(file, start=1):
                words = line.split("#", 1)[0].split()
                if words and words[0] == "v":
                    vertices.append(_vertex(words[1:4], path, number))
                elif words and words[0] == "l":
                    _add_polyline(polylines, _indices(words[1:], len(vertices), path, number), number)
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", path=path) from None
    return vertices, polylines


def _vertex(words: list[str], path: Path, line: int) -> tuple[float, ...]:
    try:
        vertex = tuple(float(word) for word in words)
    except ValueError:
        raise InputError(f"not numbers: 'v {' '.join(words)}'", path=path, place=line) from None
    if len(vertex) != 3:
        raise InputError(f"a vertex with {len(vertex)} coordinates; need 3", path=path, place=line)
    if not np.isfinite(vertex).all():
        raise InputError(f"not finite: 'v {' '.join(words)}'", path=path, place=line)
    return vertex


def _indices(words: list[str], vertex_count: int, path: Path, line: int) -> list[int]:
    """Vertices of one `l` statement, counted from 0; the texture coordinate in `7/3` is skipped."""
    indices = []
    for word in words:
        try:
            number = int(word.split("/", 1)[0])
        except ValueError:
            raise InputError(f"not a vertex: '{word}'", path=path, place=line) from None
        index = number - 1 if number > 0 else vertex_count + number
        if number == 0 or not 0 <= index < vertex_count:
            what = f"vertex {number}, but there are {vertex_count} before this line (counted from 1)"
            raise InputError(what, path=path, place=line)
        indices.append(index)
    return indices


def _add_polyline(polylines: list[_Polyline], indices: list[int], line: int) -> None:
    """Begin a polyline, or go on with the latest if this one begins at its end."""
    latest = polylines[-1].vertices if polylines else []
    is_loop = len(latest) > 1 and latest[0] == latest[-1]
    if latest and indices and not is_loop and indices[0] == latest[-1]:
        latest.extend(indices[1:])
    else:
        polylines.append(_Polyline(line, indices))
