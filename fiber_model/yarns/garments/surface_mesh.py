"""Triangle meshes that cloth is laid on: vertices in mm, faces, and surface coordinates per face corner."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from weft.fiber_model.yarns.yarns import MAX_COORDINATE_MM
from weft.files.errors import InputError

MAX_FACES = 20_000_000
WELD = 1e-7
"""Vertices closer than this part of the mesh's extent are one; files repeat vertices along UV seams."""


@dataclass(frozen=True)
class SurfaceMesh:
    """Triangles with counterclockwise corners seen from outside; cloth has its face there.

    Construction checks everything and raises `InputError`; readers use `checked`, which names their file.
    """

    vertices: np.ndarray
    """Positions [mm], float64, shape [vertex_count, 3]; a place occurs once, whatever the seams."""
    faces: np.ndarray
    """Corners of each triangle, int64, shape [face_count, 3]."""
    uv: np.ndarray | None = None
    """Surface coordinates of each corner of each triangle, float64, shape [face_count, 3, 2]."""
    uv_unit_mm: float | None = None
    """Length of one unit of `uv` on the flat cloth [mm], where it is known."""

    def __post_init__(self) -> None:
        _check(self)

    @classmethod
    def checked(
        cls,
        vertices: np.ndarray,
        faces: np.ndarray,
        uv: np.ndarray | None = None,
        *,
        uv_unit_mm: float | None = None,
        source: str | Path | None = None,
    ) -> SurfaceMesh:
        """Weld equal vertices and drop triangles without area; errors name `source`."""
        vertices = np.asarray(vertices, dtype=np.float64).reshape(-1, 3)
        faces = np.asarray(faces, dtype=np.int64).reshape(-1, 3)
        uv = None if uv is None else np.asarray(uv, dtype=np.float64)
        try:
            mesh = cls(vertices, faces, uv, uv_unit_mm)
            vertices, faces = welded(vertices, faces)
            area = double_areas(vertices, faces)
            kept = area > 1e-12 * area.max()
            if not kept.any():
                raise InputError("all triangles of the mesh are without area")
            return cls(vertices, faces[kept], None if mesh.uv is None else mesh.uv[kept], uv_unit_mm)
        except InputError as error:
            raise InputError(error.what, path=source, hint=error.hint) from None

    @property
    def face_count(self) -> int:
        """Number of triangles."""
        return len(self.faces)

    @property
    def area(self) -> float:
        """Area of all triangles [mm^2]."""
        return 0.5 * float(double_areas(self.vertices, self.faces).sum())

    def vertex_normals(self) -> np.ndarray:
        """Unit normals, each face weighted by its angle at the vertex, shape [vertex_count, 3]."""
        corner = self.vertices[self.faces]
        normal = unit_rows(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]))
        total = np.zeros_like(self.vertices)
        for k in range(3):
            a = unit_rows(corner[:, (k + 1) % 3] - corner[:, k])
            b = unit_rows(corner[:, (k + 2) % 3] - corner[:, k])
            angle = np.arccos(np.clip((a * b).sum(axis=1), -1.0, 1.0))
            np.add.at(total, self.faces[:, k], angle[:, None] * normal)
        return unit_rows(total)

    def twins(self) -> np.ndarray:
        """The half-edge across each half-edge, int64, shape [3 face_count]; -1 where there is none.

        Half-edge 3 f + k leads from corner k to corner k + 1 of face f. Edges of more than two faces, or of
        two faces that disagree on the outside, have no twins.
        """
        start = self.faces.reshape(-1)
        end = np.roll(self.faces, -1, axis=1).reshape(-1)
        key = np.minimum(start, end) * len(self.vertices) + np.maximum(start, end)
        order = np.argsort(key, kind="stable")
        _, first, count = np.unique(key[order], return_index=True, return_counts=True)
        a, b = order[first[count == 2]], order[first[count == 2] + 1]
        agree = start[a] == end[b]
        twin = np.full(len(key), -1, np.int64)
        twin[a[agree]], twin[b[agree]] = b[agree], a[agree]
        return twin


def welded(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices without repetition, and the faces on them."""
    extent = float(np.ptp(vertices, axis=0).max())
    cell = np.round((vertices - vertices.min(axis=0)) / max(WELD * extent, 1e-300)).astype(np.int64)
    _, first, index = np.unique(cell, axis=0, return_index=True, return_inverse=True)
    return vertices[first], index.reshape(-1)[faces]


def double_areas(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Twice the area of each triangle [mm^2], shape [face_count]."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1)


def unit_rows(vectors: np.ndarray) -> np.ndarray:
    """Rows of length 1; rows of length 0 stay."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(length > 0, length, 1.0)


def _check(mesh: SurfaceMesh) -> None:
    """Refuse what is no mesh."""
    vertices, faces, uv = mesh.vertices, mesh.faces, mesh.uv
    if len(faces) == 0 or len(vertices) == 0:
        raise InputError("the mesh has no triangles")
    if len(faces) > MAX_FACES:
        raise InputError(f"the mesh has {len(faces):,} triangles; at most {MAX_FACES:,} fit")
    if not np.isfinite(vertices).all():
        vertex = int(np.argmin(np.isfinite(vertices).all(axis=1)))
        raise InputError(f"vertex {vertex} of the mesh is not finite")
    if np.abs(vertices).max() > MAX_COORDINATE_MM:
        raise InputError("a vertex of the mesh lies beyond ten kilometers; check the unit")
    if faces.min() < 0 or faces.max() >= len(vertices):
        bad = int(np.argmax(((faces < 0) | (faces >= len(vertices))).any(axis=1)))
        found = ", ".join(map(str, faces[bad]))
        raise InputError(f"triangle {bad} names vertices {found}, but there are {len(vertices)}")
    if uv is not None and uv.shape != (len(faces), 3, 2):
        raise InputError(f"surface coordinates have shape {list(uv.shape)}; need [{len(faces)}, 3, 2]")
    if uv is not None and not np.isfinite(uv).all():
        bad = int(np.argmin(np.isfinite(uv).all(axis=(1, 2))))
        raise InputError(f"the surface coordinates of triangle {bad} are not finite")
