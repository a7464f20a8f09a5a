"""Reader for .poly, the polygons of PRISMS and Houdini as YarnBall reads them: text of points and edges.

`POINTS`, lines `id: x y z`, `POLYS`, lines `id: i j ...` that join points by their ids, `END`. Edges that
share a point are one yarn, in whatever order they stand; a chain that comes back to its beginning is a
loop. Points in no edge are skipped. No unit, no radius, no up axis. The points become control points.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np

from weft.fiber_model.yarns.yarns import MIN_POINTS, YarnSet
from weft.files.errors import InputError

from .bcc import turned_to_y_up
from .raw_file import read_lines, refuse_few_points

Edge = tuple[int, int]


def read_poly(
    path: str | Path,
    *,
    scale_to_mm: float,
    radius_mm: float,
    up_axis: int = 1,
    type_name: str = "yarn",
) -> YarnSet:
    """Read yarns; `scale_to_mm` is the length of one file unit [mm], `up_axis` 1 (y) or 2 (z).

    A yarn begins at whichever of its ends stands first among the points, a loop at its first point.
    """
    path = Path(path)
    points, neighbors = _read_points_and_edges(path)
    chains = _chains(neighbors)
    if not chains:
        raise InputError("no edges ('POLYS') in this file", path=path)
    for yarn, (chain, _) in enumerate(chains):
        refuse_few_points(len(chain), yarn, MIN_POINTS, path)
    turned = turned_to_y_up(np.array(points).reshape(-1, 3), up_axis) * scale_to_mm
    return YarnSet.checked(
        [turned[chain] for chain, _ in chains],
        closed=[closed for _, closed in chains],
        radius=radius_mm,
        type_names=(type_name,),
        source=path,
    )


def _read_points_and_edges(path: Path) -> tuple[list[tuple[float, ...]], list[list[int]]]:
    """Coordinates of the points in file order, and for each the points that it is joined to."""
    points: list[tuple[float, ...]] = []
    index_of: dict[int, int] = {}
    neighbors: list[list[int]] = []
    section = ""
    for number, line in read_lines(path):
        words = line.replace(":", " : ", 1).split()
        if not words:
            continue
        if words == ["END"]:
            return points, neighbors
        if words in (["POINTS"], ["POLYS"]):
            section = words[0]
        elif section == "POINTS":
            name, point = _point(words, path, number)
            if name in index_of:
                raise InputError(f"second point {name}", path=path, place=number)
            index_of[name] = len(points)
            points.append(point)
            neighbors.append([])
        elif section == "POLYS":
            _join(neighbors, _edges(words, index_of, path, number), path, number)
        else:
            shown = line.strip()[:60].encode("ascii", "backslashreplace").decode()
            raise InputError(f"found '{shown}' before 'POINTS'", path=path, place=number)
    raise InputError("the file ends without 'END'. Is it truncated?", path=path)


def _point(words: list[str], path: Path, line: int) -> tuple[int, tuple[float, ...]]:
    try:
        name, point = int(words[0]), tuple(float(word) for word in words[2:])
    except ValueError:
        name, point = 0, ()
    if len(point) != 3 or words[1] != ":" or not np.isfinite(point).all():
        raise InputError("a point needs 'id: x y z', finite numbers", path=path, place=line)
    return name, point


def _edges(words: list[str], index_of: dict[int, int], path: Path, line: int) -> list[Edge]:
    """Pairs of points, counted from 0, that one line joins."""
    try:
        names = [int(word) for word in (words[0], *words[2:])][1:]
    except ValueError:
        names = []
    if len(names) < 2 or words[1] != ":":
        raise InputError("an edge needs 'id: i j', ids of points", path=path, place=line)
    for name in names:
        if name not in index_of:
            raise InputError(f"edge to point {name}, which is not in 'POINTS'", path=path, place=line)
    indices = [index_of[name] for name in names]
    return list(pairwise(indices))


def _join(neighbors: list[list[int]], edges: list[Edge], path: Path, line: int) -> None:
    for start, end in edges:
        if start == end or end in neighbors[start]:
            raise InputError("this edge joins a point to itself or stands twice", path=path, place=line)
        if max(len(neighbors[start]), len(neighbors[end])) > 1:
            raise InputError("yarns meet or branch at this edge", path=path, place=line)
        neighbors[start].append(end)
        neighbors[end].append(start)


def _chains(neighbors: list[list[int]]) -> list[tuple[list[int], bool]]:
    """Points of each yarn in order, and whether it is a loop: open yarns by their first ends, then loops."""
    visited = [False] * len(neighbors)
    chains = []
    for ends in (1, 2):
        for start, joined in enumerate(neighbors):
            if visited[start] or len(joined) != ends:
                continue
            chain, current = [], start
            while not visited[current]:
                visited[current] = True
                chain.append(current)
                current = next((point for point in neighbors[current] if not visited[point]), current)
            chains.append((chain, ends == 2))
    return chains
