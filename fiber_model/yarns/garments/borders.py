"""Where cloth ends: free borders of a mesh, and the seams along which its charts are cut."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .surface_mesh import SurfaceMesh


@dataclass(frozen=True)
class Border:
    """A chain of edges in order, cloth to their left."""

    half_edges: np.ndarray
    """3 face + corner of each, int64, shape [n]."""
    closed: bool
    """Whether the last edge ends where the first begins."""


def free_borders(mesh: SurfaceMesh) -> list[Border]:
    """Around each hole of the mesh and along its rim."""
    return [Border(loop, True) for loop in _border_loops(mesh.faces)]


def chart_seams(mesh: SurfaceMesh) -> list[Border]:
    """Inner edges where (u, v) jumps, each once, from one of their two sides."""
    if mesh.uv is None:
        return []
    corner = np.column_stack([mesh.faces.reshape(-1), mesh.uv.reshape(-1, 2)])
    split = np.unique(corner, axis=0, return_inverse=True)[1].reshape(-1, 3)
    loops = _border_loops(split)
    twin, place = _twins(mesh.faces), np.full(3 * len(mesh.faces), -1, np.int64)
    for loop in loops:
        place[loop] = place.max() + 1 + np.arange(len(loop))
    seams = []
    for loop in loops:
        other = twin[loop]
        # a seam met twice, once along each side, is taken where it is met first
        taken = (other >= 0) & (place[loop] < place[other])
        seams += _runs(loop, taken)
    return seams


def _runs(loop: np.ndarray, taken: np.ndarray) -> list[Border]:
    """Stretches of a loop whose edges are all taken."""
    if taken.all():
        return [Border(loop, True)]
    begin = int(np.flatnonzero(~taken)[0])
    loop, taken = np.roll(loop, -begin), np.roll(taken, -begin)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], taken, [False]])))
    return [Border(loop[a:b], False) for a, b in edges.reshape(-1, 2)]


def _edge_keys(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Start and end vertex of each half-edge, and a number that both half-edges of an edge share."""
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    return start, end, np.minimum(start, end) * (int(faces.max()) + 1) + np.maximum(start, end)


def _twins(faces: np.ndarray) -> np.ndarray:
    """The other half-edge of each edge, int64; -1 on free borders."""
    key = _edge_keys(faces)[2]
    order = np.argsort(key, kind="stable")
    same = np.flatnonzero(key[order][:-1] == key[order][1:])
    twin = np.full(len(key), -1, np.int64)
    twin[order[same]], twin[order[same + 1]] = order[same + 1], order[same]
    return twin


def _border_loops(faces: np.ndarray) -> list[np.ndarray]:
    """Half-edges that have no other half, loop by loop in order."""
    start, end, key = _edge_keys(faces)
    _, index, count = np.unique(key, return_inverse=True, return_counts=True)
    border = np.flatnonzero(count[index.reshape(-1)] == 1)
    leaving = dict(zip(start[border].tolist(), border.tolist(), strict=True))
    loops = []
    while leaving:
        first, half = next(iter(leaving.items()))
        loop = []
        while half is not None:
            del leaving[int(start[half])]
            loop.append(half)
            half = leaving.get(int(end[half]))
        if end[loop[-1]] == first:
            loops.append(np.array(loop))
    return loops
