"""Hems: a yarn that runs around each free border of a mesh in overcast stitches, over the cut ends."""

from __future__ import annotations

import numpy as np

from weft.fiber_model.yarns.yarns import YarnSet

from .surface_mesh import SurfaceMesh, unit_rows

POINTS_PER_STITCH = 16
PITCH_PER_RADIUS = 4.0
"""Distance of stitches along the border; neighbors leave a yarn's width between them."""


def hem_yarns(
    mesh: SurfaceMesh,
    *,
    depth_mm: float,
    half_thickness_mm: float,
    radius_mm: float,
    offset_mm: float = 0.0,
    type_name: str = "yarn",
) -> YarnSet | None:
    """One closed yarn for each free border; None where the mesh has none.

    The stitches reach `depth_mm` into the cloth, whose centerlines lie within `half_thickness_mm` of its
    middle, and pass outside of them and of the border.
    """
    curves, uvs = [], []
    normals = mesh.vertex_normals()
    for half_edges in free_borders(mesh):
        stitched = _overcast(
            mesh, normals, half_edges, depth_mm, half_thickness_mm + 2 * radius_mm, radius_mm, offset_mm
        )
        if stitched is not None:
            curves.append(stitched[0])
            uvs.append(stitched[1])
    if not curves:
        return None
    return YarnSet.checked(curves, closed=True, radius=radius_mm, type_names=(type_name,), surface_uv=uvs)


def free_borders(mesh: SurfaceMesh) -> list[np.ndarray]:
    """Half-edges (3 face + corner) around each border of the mesh, in order; cloth lies to their left."""
    start, end = mesh.faces.reshape(-1), np.roll(mesh.faces, -1, axis=1).reshape(-1)
    key = np.minimum(start, end) * len(mesh.vertices) + np.maximum(start, end)
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


def _overcast(
    mesh: SurfaceMesh,
    normals: np.ndarray,
    half_edges: np.ndarray,
    depth: float,
    height: float,
    radius: float,
    offset: float,
) -> tuple[np.ndarray, np.ndarray] | None:
    """Control points [mm] and (u, v) of one loop of stitches; None where the border is too short for any."""
    face, corner = half_edges // 3, half_edges % 3
    vertex = mesh.faces[face, corner]
    place = mesh.vertices[vertex]
    chord = np.roll(place, -1, axis=0) - place
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(chord, axis=1))])
    stitches = round(float(arc[-1]) / (PITCH_PER_RADIUS * radius))
    if stitches < 4:
        return None
    along = unit_rows(chord + np.roll(chord, 1, axis=0))
    normal = normals[vertex]
    inward = unit_rows(np.cross(normal, along))
    s = arc[-1] * np.arange(stitches * POINTS_PER_STITCH) / (stitches * POINTS_PER_STITCH)
    turn = 2 * np.pi * np.arange(len(s)) / POINTS_PER_STITCH
    center, normal, inward = (_at(s, arc, values) for values in (place, normal, inward))
    reach = 0.5 * depth * (1 + np.cos(turn)) - 2 * radius * 0.5 * (1 - np.cos(turn))
    points = (
        center
        + reach[:, None] * unit_rows(inward)
        + (offset + height * np.sin(turn))[:, None] * unit_rows(normal)
    )
    if mesh.uv is None:
        return points, np.zeros((len(points), 2))
    edge = np.clip(np.searchsorted(arc, s, side="right") - 1, 0, len(half_edges) - 1)
    part = ((s - arc[edge]) / np.diff(arc)[edge])[:, None]
    here, there = mesh.uv[face, corner], mesh.uv[face, (corner + 1) % 3]
    return points, (1 - part) * here[edge] + part * there[edge]


def _at(s: np.ndarray, arc: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Vectors along the loop at arc lengths `s`, linear between its vertices, shape [n, 3]."""
    closed = np.concatenate([values, values[:1]])
    return np.stack([np.interp(s, arc, closed[:, axis]) for axis in range(3)], axis=1)
