"""All surfaces of a scene as rows of four floats, in the layout of shaders/geometry/ and shaders/surface/."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .balls import SingleSurface, ball_triangles, single_surfaces
from .bvh import END, Bvh, build_bvh, empty_bvh
from .instances import INSTANCED_FROM, in_voxels, instance_box, instance_rows, instanced_meshes
from .local_lights import LocalLight, light_shapes
from .materials import MATERIAL_ROWS, MaterialKinds, float_bits, material_kinds, material_rows
from .mesh import TRIANGLE, Triangles, ground_triangles, joined, mesh_triangles
from .surface_config import BallSurface, GroundSurface, Surface, TubeSurface
from .tubes import tube_triangles

NODE_ROWS = 5
TRIANGLE_ROWS = 3
ATTRIBUTE_ROWS = 4
ENTER = 0x80000000
"""Triangle count of a node that is an instance; its first triangle is then the instance's index."""


@dataclass(frozen=True)
class SurfaceTable:
    """Rows of float32, shape [row_count, 4], and where each kind begins."""

    rows: np.ndarray
    offsets: dict[str, int]
    """First row of `nodes`, `instances`, `triangles`, `attributes`, `materials`, `texels`, `measured`."""
    triangle_count: int
    instance_count: int
    kinds: MaterialKinds


def build_surface_table(
    surfaces: Sequence[Surface],
    lights: Sequence[LocalLight],
    bounds_mm: np.ndarray,
    corner_mm: np.ndarray,
    voxel_size_mm: float,
    *,
    instanced_from: int = INSTANCED_FROM,
) -> SurfaceTable | None:
    """Geometry in voxels from `corner_mm`; none where nothing can end a ray. `bounds_mm`: of the volume."""
    if not surfaces and not lights:
        return None
    singles = single_surfaces(surfaces)
    meshes, instanced = instanced_meshes(singles, instanced_from)
    copies = [
        _triangles(surface, bounds_mm, index)
        for index, surface in enumerate(singles)
        if index not in instanced
    ]
    triangles = joined([*copies, light_shapes(lights, len(singles))])
    parts = [_part(replace(triangles, corners=(triangles.corners - corner_mm) / voxel_size_mm))]
    parts += [_part(mesh.triangles) for mesh in meshes]
    places = [(i + 1, instance) for i, mesh in enumerate(meshes) for instance in mesh.instances]
    maps = [(part, *in_voxels(one, corner_mm, voxel_size_mm), one.material) for part, one in places]
    materials, texels, measured = material_rows([surface.material for surface in singles])
    sections = {
        **_hierarchy_rows(parts, maps),
        "triangles": np.concatenate([_triangle_rows(part) for part in parts]),
        "attributes": np.concatenate([_attribute_rows(part) for part in parts]),
        "materials": np.concatenate([materials, _light_materials(len(lights))]),
        "texels": texels,
        "measured": measured,
    }
    ends = np.cumsum([0, *(len(section) for section in sections.values())]).tolist()
    return SurfaceTable(
        np.concatenate(list(sections.values())),
        dict(zip(sections, ends, strict=False)),
        sum(len(part.triangles) for part in parts),
        len(maps),
        material_kinds([surface.material for surface in singles]),
    )


@dataclass(frozen=True)
class _Part:
    """Triangles as the device sees them, rounded to 32 bits, under one hierarchy."""

    triangles: Triangles
    bvh: Bvh


def _part(triangles: Triangles) -> _Part:
    rounded = replace(triangles, corners=triangles.corners.astype(np.float32).astype(np.float64))
    return _Part(rounded, _hierarchy(rounded.corners, rounded.shape))


Placed = tuple[int, np.ndarray, np.ndarray, int]
"""Index of a part, linear map and offset to the scene [voxels], material."""


def _hierarchy_rows(parts: Sequence[_Part], maps: Sequence[Placed]) -> dict[str, np.ndarray]:
    """Nodes, and instances. Where there are instances, the first nodes are the hierarchy of their places;
    what stands in the scene once is then an instance that does not move and keeps its materials.
    """
    if not maps:
        return {"nodes": _node_rows(parts[0].bvh), "instances": np.zeros((0, 4), np.float32)}
    placed = [(0, np.eye(3), np.zeros(3), -1), *maps] if len(parts[0].triangles) else list(maps)
    boxes = [
        instance_box(parts[part].bvh.lower[0], parts[part].bvh.upper[0], linear, offset)
        for part, linear, offset, _ in placed
    ]
    top = build_bvh(np.array([low for low, _ in boxes]), np.array([high for _, high in boxes]), leaf=1)
    node_ends = np.cumsum([len(top.first), *(len(part.bvh.first) for part in parts)])
    triangle_ends = np.cumsum([0, *(len(part.triangles) for part in parts)])
    leaves = np.flatnonzero(top.count)
    leaf_of = np.empty(len(placed), int)
    leaf_of[top.order[top.first[leaves]]] = leaves
    rows = [
        _node_rows(replace(top, first=top.order[np.minimum(top.first, len(placed) - 1)]), leaf_count=ENTER)
    ]
    rows += [
        _node_rows(part.bvh, node_base=int(node), triangle_base=int(triangle))
        for part, node, triangle in zip(parts, node_ends, triangle_ends, strict=False)
    ]
    instances = instance_rows(
        [(linear, offset) for _, linear, offset, _ in placed],
        [int(node_ends[part]) for part, *_ in placed],
        leaf_of.tolist(),
        [material for *_, material in placed],
    )
    return {"nodes": np.concatenate(rows), "instances": instances}


def _triangles(surface: SingleSurface, bounds_mm: np.ndarray, material: int) -> Triangles:
    if isinstance(surface, GroundSurface):
        return ground_triangles(surface, bounds_mm, material)
    if isinstance(surface, BallSurface):
        return ball_triangles(surface, material)
    if isinstance(surface, TubeSurface):
        return tube_triangles(surface, material)
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


def _node_rows(
    bvh: Bvh, *, node_base: int = 0, triangle_base: int = 0, leaf_count: int | None = None
) -> np.ndarray:
    """(lower, first triangle), (upper, triangle count), links of two directions in each of three."""
    rows = np.empty((len(bvh.first), NODE_ROWS, 4), np.float32)
    count = bvh.count if leaf_count is None else np.where(bvh.count > 0, leaf_count, 0)
    links = np.where(bvh.links == END, bvh.links, bvh.links + np.uint32(node_base))
    rows[:, 0, :3], rows[:, 1, :3] = bvh.lower, bvh.upper  # both are float32 already
    rows[:, 0, 3], rows[:, 1, 3] = float_bits(bvh.first + triangle_base), float_bits(count)
    rows[:, 2:] = links.astype(np.uint32).view(np.float32).reshape(-1, 3, 4)
    return rows.reshape(-1, 4)


def _triangle_rows(part: _Part) -> np.ndarray:
    """(corner, material), (first edge, shape), (second edge, 0)."""
    corners, order = part.triangles.corners, part.bvh.order
    rows = np.zeros((len(corners), TRIANGLE_ROWS, 4), np.float32)
    rows[:, 0, :3], rows[:, 0, 3] = corners[order, 0], float_bits(part.triangles.material[order])
    rows[:, 1:, :3] = corners[order, 1:] - corners[order, :1]
    rows[:, 1, 3] = part.triangles.shape[order]
    return rows.reshape(-1, 4)


def _attribute_rows(part: _Part) -> np.ndarray:
    """(normal, u) of each corner; (v of each corner, 0)."""
    triangles, order = part.triangles, part.bvh.order
    rows = np.zeros((len(order), ATTRIBUTE_ROWS, 4), np.float32)
    rows[:, :3, :3], rows[:, :3, 3] = triangles.normals[order], triangles.uvs[order, :, 0]
    rows[:, 3, :3] = triangles.uvs[order, :, 1]
    return rows.reshape(-1, 4)
