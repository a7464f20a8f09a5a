"""Reader for .pyp, the periodic yarn patterns of MADYPG (Sperl, Narain and Wojtan 2021). Text, SI meters.

Sections, one row of values per vertex: *pattern (period x, period y, radius, vertex count), *Q (x y z
twist), *E (v0 v1 dx dy: an edge to vertex v1 of the tile dx, dy away), *RL (rest length), *RefD1 (reference
director). Twist, rest length and director of row v belong to the edge that leaves vertex v; the files do
not say so, but only this reading makes every director perpendicular to its edge. Skipped: *RK, *RT, *RefT
(rest curvature, rest twist, reference twist).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from weft.fiber_model.yarns.fabrics.tile import PeriodicTile
from weft.fiber_model.yarns.yarns import refuse_too_many_points
from weft.files.errors import InputError

COLUMNS = {"pattern": 4, "Q": 4, "E": 4, "RL": 1, "RefD1": 3}
SKIPPED = ("RK", "RT", "RefT")
MAX_FILE_BYTES = 1 << 30
MAX_STEP = 1000
"""Largest tile step of an edge; real patterns step to a neighbor."""


@dataclass(frozen=True)
class _Section:
    """Rows of one section and the line of its heading."""

    heading_line: int
    lines: list[int]
    rows: list[list[str]]


def read_pyp(path: str | Path, *, scale_to_mm: float = 1000.0) -> PeriodicTile:
    """Read a periodic tile; `scale_to_mm` is the length of one file unit [mm], by default a meter."""
    path = Path(path)
    sections = _read_sections(path)
    for name in ("pattern", "Q", "E"):
        if name not in sections:
            raise InputError(f"no section '*{name}'; a .pyp file needs *pattern, *Q and *E", path=path)
    period_x, period_y, radius, count = _read_pattern(sections["pattern"], path)
    refuse_too_many_points(count, "the tile", path=path)
    values = {
        name: _numbers(section, name, count, path)
        for name, section in sections.items()
        if name in COLUMNS and name != "pattern"
    }
    next_vertex, next_step = _link_vertices(values["E"], sections["E"], count, path)
    return PeriodicTile(
        period=np.array([period_x, period_y]) * scale_to_mm,
        radius=radius * scale_to_mm,
        points=values["Q"][:, :3] * scale_to_mm,
        next_vertex=next_vertex,
        next_step=next_step,
        director=values.get("RefD1"),
        twist=values["Q"][:, 3],
        rest_length=values["RL"][:, 0] * scale_to_mm if "RL" in values else None,
    )


def _read_sections(path: Path) -> dict[str, _Section]:
    """Split the text into sections; `#` starts a comment."""
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise InputError("over 1 GiB; not a yarn pattern", path=path)
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", path=path) from None
    except UnicodeDecodeError as error:
        raise InputError("not a text file", path=path, place=f"byte {error.start}") from None
    sections: dict[str, _Section] = {}
    current: _Section | None = None
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split("#", 1)[0].split()
        if not words:
            continue
        if words[0].startswith("*"):
            current = _open_section(sections, words[0][1:], number, path)
        elif current is None:
            raise InputError(f"found '{words[0]}' before the first section", path=path, place=number)
        else:
            current.lines.append(number)
            current.rows.append(words)
    return sections


def _open_section(sections: dict[str, _Section], name: str, line: int, path: Path) -> _Section:
    if name not in COLUMNS and name not in SKIPPED:
        known = ", ".join(f"*{known}" for known in (*COLUMNS, *SKIPPED))
        raise InputError(f"unknown section '*{name}'; known are {known}", path=path, place=line)
    if name in sections:
        raise InputError(f"second section '*{name}'", path=path, place=line)
    sections[name] = _Section(line, [], [])
    return sections[name]


def _read_pattern(section: _Section, path: Path) -> tuple[float, float, float, int]:
    """Period, radius and number of vertices."""
    row = _numbers(section, "pattern", 1, path)[0]
    if (row <= 0).any() or row[3] != np.floor(row[3]):
        what = "needs a positive period, radius and vertex count"
        raise InputError(f"*pattern {what}; found {row.tolist()}", path=path, place=section.lines[0])
    return float(row[0]), float(row[1]), float(row[2]), int(row[3])


def _numbers(section: _Section, name: str, count: int, path: Path) -> np.ndarray:
    """The rows of a section as numbers, float64, shape [count, columns]."""
    columns = COLUMNS[name]
    if len(section.rows) != count:
        what = f"section '*{name}' has {len(section.rows)} rows; need {count}"
        raise InputError(f"{what}. Is the file truncated?", path=path, place=section.heading_line)
    values = np.empty((count, columns))
    for row, (line, words) in enumerate(zip(section.lines, section.rows, strict=True)):
        if len(words) != columns:
            raise InputError(f"found {len(words)} values in '*{name}'; need {columns}", path=path, place=line)
        try:
            values[row] = [float(word) for word in words]
        except ValueError:
            raise InputError(f"not numbers: '{' '.join(words)}'", path=path, place=line) from None
    bad = ~np.isfinite(values).all(axis=1)
    if bad.any():
        row = int(np.argmax(bad))
        words = section.rows[row]
        raise InputError(f"not finite: '{' '.join(words)}'", path=path, place=section.lines[row])
    return values


def _link_vertices(
    edges: np.ndarray, section: _Section, count: int, path: Path
) -> tuple[np.ndarray, np.ndarray]:
    """The vertex after each one and the tile it lies in."""
    next_vertex = np.full(count, -1, np.int64)
    next_step = np.zeros((count, 2), np.int64)
    has_previous = np.zeros(count, bool)
    for line, edge in zip(section.lines, edges, strict=True):
        if (edge != np.floor(edge)).any() or (np.abs(edge[2:]) > MAX_STEP).any():
            raise InputError("an edge needs two vertices and two small tile steps", path=path, place=line)
        start, end = edge[:2]
        if min(start, end) < 0 or max(start, end) >= count:
            wrong = int(start if not 0 <= start < count else end)
            what = f"edge names vertex {wrong}, but there are {count} (counted from 0)"
            raise InputError(what, path=path, place=line)
        if next_vertex[int(start)] >= 0 or has_previous[int(end)]:
            raise InputError("yarns meet or branch at this edge", path=path, place=line)
        next_vertex[int(start)] = int(end)
        next_step[int(start)] = edge[2:]
        has_previous[int(end)] = True
    return next_vertex, next_step
