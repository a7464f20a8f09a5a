"""Reader for .yarns, the yarn curves of smobj (Carnegie Mellon Textiles Lab, github.com/textiles-lab/smobj).

Chunks, little endian: a tag of 4 bytes, uint32 size, data. In this order: `f3..` points (3 float32), `src.`
a uint32 source line per point, `yarn` (uint32 first point, uint32 point after the last, float32 radius, 4
bytes of color); then, where present, `strs`, `unit` and `chk.`, which are skipped, as are lines and colors.
The first `unit` of a file is always "1", which says nothing of millimeters. No up axis; smobj's own
converters take z.

A yarn is the quadratic B-spline of its points: straight from the first to the middle of the first edge,
then parabolas between the middles of edges. It is a loop where its last point equals its first.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from weft.fiber_model.yarns.catmull_rom import CatmullRom
from weft.fiber_model.yarns.yarns import YarnSet, refuse_too_many_points
from weft.files.errors import InputError

from .bcc import turned_to_y_up
from .follow import follow_curves
from .raw_file import read_bytes, refuse_few_points, refuse_not_finite

CHUNK_HEAD = struct.Struct("<4sI")
ELEMENT_BYTES = {b"f3..": 12, b"src.": 4, b"yarn": 16, b"strs": 1, b"unit": 12, b"chk.": 12}
NEEDED = (b"f3..", b"src.", b"yarn")
YARN = np.dtype([("begin", "<u4"), ("end", "<u4"), ("radius", "<f4"), ("color", "u1", 4)])


def read_smobj_yarns(
    path: str | Path,
    *,
    scale_to_mm: float,
    radius_mm: float | None = None,
    up_axis: int = 1,
    type_name: str = "yarn",
) -> YarnSet:
    """Read yarns; `scale_to_mm` is the length of one file unit [mm], `up_axis` 1 (y) or 2 (z).

    `radius_mm` replaces the radii of the file.
    """
    path = Path(path)
    data = read_bytes(path)
    chunks = _find_chunks(data, path)
    begin, size = chunks[b"f3.."]
    refuse_too_many_points(size // 12, "the file", path=path)
    points = np.frombuffer(data, "<f4", count=size // 4, offset=begin).reshape(-1, 3)
    yarns = np.frombuffer(data, YARN, count=chunks[b"yarn"][1] // 16, offset=chunks[b"yarn"][0])
    _check_yarns(yarns, points, begin, chunks[b"yarn"][0], path)
    turned = turned_to_y_up(points.astype(np.float64), up_axis) * scale_to_mm
    pieces, closed = [], []
    for first, last in zip(yarns["begin"], yarns["end"], strict=True):
        curve = turned[first:last]
        closed.append(last - first > 3 and bool((curve[0] == curve[-1]).all()))
        pieces.append(_loop(curve[:-1]) if closed[-1] else _open(curve))
    radius = yarns["radius"] * scale_to_mm if radius_mm is None else np.full(len(yarns), radius_mm)
    offsets = np.cumsum([0] + [len(piece) for piece in pieces])
    curves = CatmullRom(np.concatenate(pieces), offsets)
    controls = follow_curves(curves, np.array(closed), radius.astype(np.float64), source=path)
    return YarnSet.checked(
        controls, closed=closed, radius=radius.tolist(), type_names=(type_name,), source=path
    )


def _find_chunks(data: bytes, path: Path) -> dict[bytes, tuple[int, int]]:
    """First byte and size of each chunk; every one lies within the file."""
    chunks: dict[bytes, tuple[int, int]] = {}
    order = list(ELEMENT_BYTES)
    at = 0
    while at < len(data):
        place = f"byte {at}"
        if at + CHUNK_HEAD.size > len(data):
            raise InputError("the file ends within the head of a chunk", path=path, place=place)
        tag, size = CHUNK_HEAD.unpack_from(data, at)
        if len(chunks) == len(order) or tag != order[len(chunks)]:
            wanted = f"; need '{order[len(chunks)].decode()}'" if len(chunks) < len(order) else ""
            shown = tag.decode("ascii", "backslashreplace")
            raise InputError(f"chunk '{shown}'{wanted}", path=path, place=place)
        at += CHUNK_HEAD.size
        if size > len(data) - at or size % ELEMENT_BYTES[tag]:
            needed = f"need a multiple of {ELEMENT_BYTES[tag]}, at most {len(data) - at}"
            what = f"chunk '{tag.decode()}' of {size} bytes; {needed}"
            raise InputError(f"{what}. Is the file truncated?", path=path, place=place)
        chunks[tag] = (at, size)
        at += size
    for tag in NEEDED:
        if tag not in chunks:
            what = f"no chunk '{tag.decode()}'. Is the file truncated?"
            raise InputError(what, path=path, place=f"byte {len(data)}")
    if chunks[b"src."][1] // 4 != chunks[b"f3.."][1] // 12:
        raise InputError("'src.' has not one line per point", path=path, place=f"byte {chunks[b'src.'][0]}")
    return chunks


def _check_yarns(yarns: np.ndarray, points: np.ndarray, points_at: int, yarns_at: int, path: Path) -> None:
    """Refuse yarns beyond the points, over each other's points, too short or not finite."""
    if not len(yarns):
        raise InputError("there are no yarns; need at least one", path=path)
    used = 0
    for yarn, (first, last) in enumerate(zip(yarns["begin"].tolist(), yarns["end"].tolist(), strict=True)):
        place = f"byte {yarns_at + 16 * yarn}"
        used += max(last - first, 0)
        if not first <= last <= len(points) or used > len(points):
            what = f"yarn {yarn} has points {first} to {last}, but there are {len(points)}, each for one yarn"
            raise InputError(what, path=path, place=place)
        refuse_few_points(last - first, yarn, 2, path, place=place, kind="yarn here")
        refuse_not_finite(points[first:last], yarn, points_at + 12 * first, path)


def _open(points: np.ndarray) -> np.ndarray:
    """Coefficients of the straight ends and of the parabolas between, shape [segments, 4 (power), 3]."""
    middle = 0.5 * (points[:-1] + points[1:])
    line = np.zeros((1, 4, 3))
    begin, end = line.copy(), line.copy()
    begin[0, 0], begin[0, 1] = points[0], middle[0] - points[0]
    end[0, 0], end[0, 1] = middle[-1], points[-1] - middle[-1]
    return np.concatenate([begin, _parabolas(middle[:-1], points[1:-1], middle[1:]), end])


def _loop(points: np.ndarray) -> np.ndarray:
    """Coefficients of the parabola about each point, shape [points, 4 (power), 3]."""
    after = np.roll(points, -1, axis=0)
    middle = 0.5 * (points + after)
    return _parabolas(middle, after, np.roll(middle, -1, axis=0))


def _parabolas(start: np.ndarray, control: np.ndarray, end: np.ndarray) -> np.ndarray:
    zero = np.zeros_like(start)
    return np.stack([start, 2 * (control - start), start - 2 * control + end, zero], axis=1)
