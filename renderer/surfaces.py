"""All surfaces of a scene as rows of four floats, in the layout of shaders/geometry/ and shaders/surface/."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .balls import SingleSurface, ball_triangles, single_surfaces
from .bvh import Bvh, build_bvh, empty_bvh
from .local_lights import LocalLight, light_shapes
from .materials import MATERIAL_ROWS, MaterialKinds, float_bits, material_kinds, material_rows
from .mesh import TRIANGLE, Triangles, ground_triangles, joined, mesh_triangles
from .surface_config import BallSurface, GroundSurface, Surface

NODE_ROWS = 5
TRIANGLE_ROWS = 3
ATTRIBUTE_ROWS = 4


@dataclass(frozen=True)
class SurfaceTable:
    """Rows of float32, shape [row_count, 4], and where each kind begins."""

    rows: np.ndarray
    offsets: dict[str, int]
    """First row of `nodes`, `triangles`, `attributes`, `materials`, `texels`, `measured`."""
    triangle_count: int
    kinds: MaterialKinds


def build_surface_table(
    surfaces: Sequence[Surface],
    lights: Sequence[LocalLight],
    bounds_mm: np.ndarray,
    corner_mm: np.ndarray,
    voxel_size_mm: float,
) -> SurfaceTable | None:
    """Geometry in voxels from `corner_mm`; none where nothing can end a ray. `bounds_mm`: of the volume."""
    if not surfaces and not lights:
        return None
    singles = single_surfaces(surfaces)
    meshes = [_triangles(surface, bounds_mm, index) for index, surface in enumerate(singles)]
    triangles = joined([*meshes, light_shapes(lights, len(singles))])
    # what the device sees, which is rounded to 32 bits
    corners = ((triangles.corners - corner_mm) / voxel_size_mm).astype(np.float32).astype(np.float64)
    bvh = _hierarchy(corners, triangles.shape)
    materials, texels, measured = material_rows([surface.material for surface in singles])
    materials = np.concatenate([materials, _light_materials(len(lights))])
    parts = {
        "nodes": _node_rows(bvh),
        "triangles": _triangle_rows(corners, triangles, bvh.order),
        "attributes": _attribute_rows(triangles, bvh.order),
        "materials": materials,
        "texels": texels,
        "measured": measured,
    }
    ends = np.cumsum([0, *(len(part) for part in parts.values())]).tolist()
    rows = np.concatenate(list(parts.values()))
    return SurfaceTable(
        rows,
        dict(zip(parts, ends, strict=False)),
        len(triangles),
        material_kinds([surface.material for surface in singles]),
    )


def _triangles(surface: SingleSurface, bounds_mm: np.ndarray, material: int) -> Triangles:
    if isinstance(surface, GroundSurface):
        return ground_triangles(surface, bounds_mm, material)
    if isinstance(surface, BallSurface):
        return ball_triangles(surface, material)
    return mesh_triangles(surface, material)


def _hierarchy(corners: np.ndarray, shape: np.ndarray) -> Bvh:
    """Over triangles and shapes with a fourth corner; of nothing, a box that no ray meets."""
    if not len(corners):
        return empty_bvh()
    # a triangle's first corner twice does not change its box
    fourth = np.where(shape == TRIANGLE, 0, 1)[:, None] * (corners[:, 1] + corners[:, 2] - 2 * corners[:, 0])
    hull = np.concatenate([corners, corners[:, :1] + fourth[:, None]], axis=1)
    # outward by an ulp where the shader's sum of two edges rounds differently
    lower, upper = hull.min(axis=1).astype(np.float32), hull.max(axis=1).astype(np.float32)
    nonflat = (shape != TRIANGLE)[:, None]
    lower = np.where(nonflat, np.nextafter(lower, np.float32(-np.inf)), lower)
    upper = np.where(nonflat, np.nextafter(upper, np.float32(np.inf)), upper)
    return build_bvh(lower.astype(np.float64), upper.astype(np.float64))


def _light_materials(count: int) -> np.ndarray:
    """One for each light: (0, 0, 0, 1 + its index)."""
    rows = np.zeros((count, MATERIAL_ROWS, 4), np.float32)
    rows[:, 0, 3] = float_bits(np.arange(1, count + 1))
    return rows.reshape(-1, 4)


def _node_rows(bvh: Bvh) -> np.ndarray:
    """(lower, first triangle), (upper, triangle count), links of two directions in each of three."""
    rows = np.empty((len(bvh.first), NODE_ROWS, 4), np.float32)
    rows[:, 0, :3], rows[:, 1, :3] = bvh.lower, bvh.upper  # both are float32 already
    rows[:, 0, 3], rows[:, 1, 3] = float_bits(bvh.first), float_bits(bvh.count)
    rows[:, 2:] = bvh.links.view(np.float32).reshape(-1, 3, 4)
    return rows.reshape(-1, 4)


def _triangle_rows(corners: np.ndarray, triangles: Triangles, order: np.ndarray) -> np.ndarray:
    """(corner, material), (first edge, shape), (second edge, 0)."""
    rows = np.zeros((len(corners), TRIANGLE_ROWS, 4), np.float32)
    rows[:, 0, :3], rows[:, 0, 3] = corners[order, 0], float_bits(triangles.material[order])
    rows[:, 1:, :3] = corners[order, 1:] - corners[order, :1]
    rows[:, 1, 3] = triangles.shape[order]
    return rows.reshape(-1, 4)


def _attribute_rows(triangles: Triangles, order: np.ndarray) -> np.ndarray:
    """(normal, u) of each corner; (v of each corner, 0)."""
    rows = np.zeros((len(order), ATTRIBUTE_ROWS, 4), np.float32)
    rows[:, :3, :3], rows[:, :3, 3] = triangles.normals[order], triangles.uvs[order, :, 0]
    rows[:, 3, :3] = triangles.uvs[order, :, 1]
    return rows.reshape(-1, 4)
