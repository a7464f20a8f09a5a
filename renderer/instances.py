"""Meshes that stand in the scene many times: one hierarchy each, entered through one of their places."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from .balls import SingleSurface, unit_ball
from .mesh import Triangles, load_mesh, rotation_matrix, with_flat_normals
from .surface_config import BallSurface, MeshSurface

INSTANCED_FROM = 20_000
"""Triangles of all copies of a mesh from which they share one hierarchy; below, copies are faster."""
INSTANCE_ROWS = 7
PADDING = 1e-5
"""Of the boxes around instances, relative to their size: the shader turns rays in 32 bits."""


@dataclass(frozen=True)
class Instance:
    """One place of a mesh: x -> linear x + offset, in mm; float64."""

    linear: np.ndarray
    """Shape [3, 3]."""
    offset: np.ndarray
    """Shape [3]."""
    material: int


@dataclass(frozen=True)
class InstancedMesh:
    """Triangles in a unit of their own, and where they stand."""

    triangles: Triangles
    instances: list[Instance]


def instanced_meshes(
    surfaces: Sequence[SingleSurface], least: int = INSTANCED_FROM
) -> tuple[list[InstancedMesh], set[int]]:
    """Meshes worth it, and the surfaces that are in them by index, which is also that of their material."""
    wanted: dict[object, list[tuple[int, list[Instance]]]] = {}
    loads: dict[object, Callable[[], Triangles]] = {}
    for index, surface in enumerate(surfaces):
        if isinstance(surface, BallSurface):
            key: object = "ball"
            loads[key] = unit_ball
            places = [Instance(np.eye(3) * surface.radius_mm, np.array(surface.position_mm), index)]
        elif isinstance(surface, MeshSurface):
            key = (surface.file, surface.smooth)
            loads[key] = _loader(surface)
            places = mesh_instances(surface, index)
        else:
            continue
        wanted.setdefault(key, []).append((index, places))
    meshes, used = [], set()
    for key, found in wanted.items():
        instances = [instance for _, places in found for instance in places]
        if len(instances) > 1 and len(triangles := loads[key]()) * len(instances) >= least:
            meshes.append(InstancedMesh(triangles, instances))
            used |= {index for index, _ in found}
    return meshes, used


def mesh_instances(surface: MeshSurface, material: int) -> list[Instance]:
    """Its placements as maps."""
    return [
        Instance(
            rotation_matrix(one.rotation_deg) * (one.scale_xyz * surface.unit_mm),
            np.array(one.position_mm),
            material,
        )
        for one in surface.placements
    ]


def _loader(surface: MeshSurface) -> Callable[[], Triangles]:
    def load() -> Triangles:
        mesh = load_mesh(surface.file)
        return mesh if surface.smooth else with_flat_normals(mesh)

    return load


def in_voxels(
    instance: Instance, corner_mm: np.ndarray, voxel_size_mm: float
) -> tuple[np.ndarray, np.ndarray]:
    """The map to voxels from `corner_mm`: linear part and offset."""
    return instance.linear / voxel_size_mm, (instance.offset - corner_mm) / voxel_size_mm


def instance_box(
    lower: np.ndarray, upper: np.ndarray, linear: np.ndarray, offset: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Around the moved box, a little too large, as 32-bit numbers."""
    signs = np.array(list(np.ndindex(2, 2, 2)))
    corners = np.where(signs, upper, lower) @ linear.T + offset
    low, high = corners.min(axis=0), corners.max(axis=0)
    pad = PADDING * (np.ptp(corners, axis=0).max() + np.abs(corners).max() * 0.1)
    return (low - pad).astype(np.float32).astype(float), (high + pad).astype(np.float32).astype(float)


def instance_rows(
    maps: Sequence[tuple[np.ndarray, np.ndarray]],
    roots: Sequence[int],
    leaves: Sequence[int],
    materials: Sequence[int],
) -> np.ndarray:
    """Per instance: rows of the map from the scene and of the one to it, (root node, leaf, material, 0).

    The numbers of the last row are bits; a material of -1 leaves each triangle its own.
    """
    rows = np.zeros((len(maps), INSTANCE_ROWS, 4), np.float32)
    for row, (linear, offset), root, leaf, material in zip(rows, maps, roots, leaves, materials, strict=True):
        inverse = np.linalg.inv(linear)
        row[:3, :3], row[:3, 3] = inverse, -inverse @ offset
        row[3:6, :3], row[3:6, 3] = linear, offset
        row[6, :3] = np.array([root, leaf, material], np.int64).astype(np.uint32).view(np.float32)
    return rows.reshape(-1, 4)
