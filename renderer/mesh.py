"""Triangles: from files (trimesh reads OBJ, PLY, glTF, STL), from a ground plane, placed in the scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from weft.files.errors import InputError

from .surface_config import GroundSurface, MeshSurface, Placement

if TYPE_CHECKING:
    import trimesh

TRIANGLE, PARALLELOGRAM, DISK = 0, 1, 2
"""What the edges from the first corner to the two others span; lights are not triangles."""
DEGENERATE = 1e-12
"""Area [relative to the longest edge squared] below which a triangle has no direction and is left out."""


@dataclass(frozen=True)
class Triangles:
    """Triangles with what is interpolated over them, float64."""

    corners: np.ndarray
    """[mm], shape [triangle_count, 3, 3]."""
    normals: np.ndarray
    """At the corners, same shape; unit, but shorter where the mesh was scaled unevenly."""
    uvs: np.ndarray
    """Shape [triangle_count, 3, 2]; zero where the file has none."""
    material: np.ndarray
    """Index, int, shape [triangle_count]."""
    shape: np.ndarray
    """TRIANGLE, PARALLELOGRAM or DISK, int, same shape."""

    def __len__(self) -> int:
        return len(self.corners)


def joined(parts: Sequence[Triangles]) -> Triangles:
    """All triangles together."""
    names = ("corners", "normals", "uvs", "material", "shape")
    return Triangles(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def mesh_triangles(surface: MeshSurface, material: int) -> Triangles:
    """The mesh in all its placements."""
    mesh = load_mesh(surface.file)
    if not surface.smooth:
        mesh = with_flat_normals(mesh)
    mesh = replace(mesh, material=np.full(len(mesh), material))
    return joined([placed(mesh, one, surface.unit_mm) for one in surface.placements])


def load_mesh(path: Path) -> Triangles:
    """The file's triangles in its own unit. Raises `InputError` for what is not a usable mesh."""
    return triangles_of(read_mesh(path), path)


def read_mesh(path: Path) -> trimesh.Trimesh:
    """The file, its vertices as they are. Raises `InputError` where it is no mesh, or not finite."""
    import trimesh

    if not Path(path).is_file():
        raise InputError("no such file.", path=path)
    try:
        mesh = trimesh.load(path, force="mesh", process=False)
    except Exception as error:  # trimesh passes on whatever its readers raise
        raise InputError(f"not a readable mesh: {error}.", path=path) from error
    if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
        raise InputError("no triangles.", path=path, hint="A mesh is needed, not points or curves.")
    if not np.isfinite(mesh.vertices).all():
        bad = int(np.flatnonzero(~np.isfinite(mesh.vertices).all(axis=1))[0])
        raise InputError(f"vertex {bad} has a coordinate that is not finite.", path=path)
    return mesh


def triangles_of(mesh: trimesh.Trimesh, path: Path) -> Triangles:
    """Those that have an area; `path` is named where none has."""
    corners = np.asarray(mesh.vertices, np.float64)[mesh.faces]
    kept = has_area(corners)
    if not kept.any():
        raise InputError("all triangles are degenerate: they have no area.", path=path)
    faces = np.asarray(mesh.faces)[kept]
    uv = getattr(mesh.visual, "uv", None)
    uvs = np.zeros((len(mesh.vertices), 2)) if uv is None else np.asarray(uv, np.float64)
    return Triangles(
        corners[kept],
        _vertex_normals(np.asarray(mesh.vertex_normals, np.float64)[faces], corners[kept]),
        np.nan_to_num(uvs[faces]),
        np.zeros(len(faces), int),
        np.zeros(len(faces), int),
    )


def has_area(corners: np.ndarray) -> np.ndarray:
    """Which triangles are not degenerate, shape [triangle_count]."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    longest = np.maximum(np.maximum(_square(first), _square(second)), _square(second - first))
    return np.sqrt(_square(np.cross(first, second))) > DEGENERATE * longest


def placed(mesh: Triangles, placement: Placement, unit_mm: float) -> Triangles:
    """Scaled, turned and moved; normals stay across the surface where it is scaled unevenly."""
    turn, scale = rotation_matrix(placement.rotation_deg), placement.scale_xyz
    corners = mesh.corners * (unit_mm * scale) @ turn.T + np.array(placement.position_mm)
    # of uneven length: between corners they count as in an instance, whose normal is turned as a whole
    normals = mesh.normals * (scale.min() / scale)
    return replace(mesh, corners=corners, normals=normals @ turn.T)


def with_flat_normals(mesh: Triangles) -> Triangles:
    """Each triangle's own, at its corners."""
    return replace(mesh, normals=_flat_normals(mesh.corners))


def rotation_matrix(degrees: tuple[float, float, float]) -> np.ndarray:
    """About x, then y, then z; shape [3, 3]."""
    total = np.eye(3)
    for axis, angle in enumerate(np.radians(degrees)):
        c, s = np.cos(angle), np.sin(angle)
        turn = np.eye(3)
        i, j = (axis + 1) % 3, (axis + 2) % 3
        turn[i, i], turn[i, j], turn[j, i], turn[j, j] = c, -s, s, c
        total = turn @ total
    return total


def ground_triangles(surface: GroundSurface, bounds_mm: np.ndarray, material: int) -> Triangles:
    """A square that the volume with corners `bounds_mm`, shape [2, 3], stands on."""
    normal = np.array(surface.normal, np.float64)
    length = np.linalg.norm(normal)
    if not length > 0:
        raise InputError("render.surfaces: the ground's normal is zero.")
    normal /= length
    middle, half = bounds_mm.mean(axis=0), np.ptp(bounds_mm, axis=0) / 2
    middle = middle - normal * (np.abs(normal) @ half + surface.gap_mm)
    size = surface.size_mm or 20 * float(np.linalg.norm(half))
    across = np.cross([0.0, 1.0, 0.0] if abs(normal[1]) < 0.9 else [0.0, 0.0, -1.0], normal)
    across /= np.linalg.norm(across)
    along = np.cross(normal, across)
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2
    corners = middle + size * signs @ np.stack([across, along])
    uvs = signs * size / surface.texture_size_mm + 0.5
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    normals = np.broadcast_to(normal, (2, 3, 3))
    return Triangles(corners[faces], normals, uvs[faces], np.full(2, material), np.zeros(2, int))


def _vertex_normals(normals: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Of unit length; flat where the file's are zero, not finite or against the triangle."""
    flat = _flat_normals(corners)
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    usable = np.isfinite(length) & (length > 1e-6)
    unit = np.where(usable, normals, flat) / np.where(usable, length, 1)
    return np.where((unit * flat).sum(-1, keepdims=True) > 0, unit, flat)


def _flat_normals(corners: np.ndarray) -> np.ndarray:
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    return np.broadcast_to(normal[:, None], corners.shape)


def _square(v: np.ndarray) -> np.ndarray:
    return (v * v).sum(axis=-1)
