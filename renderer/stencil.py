"""The closed mesh outside of which a volume is empty: voxels whose middle lies outside of it hold no fiber.

Inside or outside is decided by counting how often the mesh is crossed below a voxel, column by column.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from weft.files.errors import InputError
from weft.voxelize.grid import BRICK_SIZE, FiberGrid, FiberVolume

from .mesh import placed, read_mesh, triangles_of
from .surface_config import Stencil

ASIDE = (3.1e-5, 1.7e-5)
"""Where a column runs beside the middle of its voxels [voxels], so that it meets no edge on their faces."""


def cut_out(volume: FiberVolume, stencil: Stencil) -> FiberVolume:
    """What lies inside. Raises `InputError` for a mesh that is not closed, or with nothing inside."""
    corners = closed_mesh_corners(stencil, "the stencil mesh")
    grids = {name: _cut_grid(grid, corners) for name, grid in volume.grids.items()}
    if not any(grid.voxel_count for grid in grids.values()):
        what = "no fiber lies inside of the stencil mesh."
        raise InputError(what, path=stencil.file, hint="Check unit_mm and placement.")
    return replace(volume, grids=grids)


def closed_mesh_corners(stencil: Stencil, what: str) -> np.ndarray:
    """Corners of its triangles [mm], shape [n, 3, 3]. Raises `InputError` where `what` is not closed."""
    mesh = read_mesh(stencil.file)
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    if not mesh.is_watertight:
        hint = "Every edge must belong to two triangles."
        raise InputError(f"{what} is not closed.", path=stencil.file, hint=hint)
    return placed(triangles_of(mesh, stencil.file), stencil.placement, stencil.unit_mm).corners


def _cut_grid(grid: FiberGrid, corners_mm: np.ndarray) -> FiberGrid:
    inside = inside_of_voxels(grid.origins, corners_mm / grid.voxel_size_mm)
    kept = (inside & (grid.density > 0)).any(axis=1)
    inside, channels = inside[kept], {name: array[kept] for name, array in grid.channels.items()}
    shown: dict[str, Any] = {
        name: np.where(inside if array.ndim == 2 else inside[..., None], array, np.float32(0))
        for name, array in channels.items()
    }
    return replace(grid, origins=grid.origins[kept], **shown)


def inside_of_voxels(origins: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Whether the middle of each voxel of bricks lies inside. `corners`: of triangles [voxels]; [n, 512]."""
    if not len(origins):
        return np.zeros((0, BRICK_SIZE**3), bool)
    low, size = origins[:, :2].min(axis=0), np.ptp(origins[:, :2], axis=0) + BRICK_SIZE
    columns, heights = crossings(corners, low, size)
    bottom = min(float(heights.min(initial=0)), float(origins[:, 2].min())) - 1
    span = max(float(heights.max(initial=0)), float(origins[:, 2].max()) + BRICK_SIZE) - bottom + 2
    keys = np.sort(columns * span + (heights - bottom))
    local = np.stack(np.meshgrid(*[np.arange(BRICK_SIZE)] * 3, indexing="ij"), -1).reshape(-1, 3)
    voxels = origins[:, None, :] + local
    column = (voxels[..., 0] - low[0]) * size[1] + voxels[..., 1] - low[1]
    below = np.searchsorted(keys, column * span + (voxels[..., 2] + 0.5 - bottom))
    return (below - np.searchsorted(keys, column * span)) % 2 == 1


def crossings(corners: np.ndarray, low: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where columns of voxels, at `low` + [0, `size`), meet the triangles: column numbers and heights."""
    found: list[tuple[np.ndarray, np.ndarray]] = [(np.zeros(0, np.int64), np.zeros(0))]
    middle = low + 0.5 + np.array(ASIDE)
    for triangle in corners:
        flat = triangle[:, :2] - middle
        first = np.maximum(np.ceil(flat.min(axis=0)), 0).astype(int)
        last = np.minimum(np.floor(flat.max(axis=0)), size - 1).astype(int)
        if (last < first).any():
            continue
        x, y = np.meshgrid(np.arange(first[0], last[0] + 1), np.arange(first[1], last[1] + 1), indexing="ij")
        (ax, ay), e1, e2 = flat[0], flat[1] - flat[0], flat[2] - flat[0]
        area = e1[0] * e2[1] - e1[1] * e2[0]
        if area == 0:
            continue
        b1 = ((x - ax) * e2[1] - (y - ay) * e2[0]) / area
        b2 = (e1[0] * (y - ay) - e1[1] * (x - ax)) / area
        met = (b1 >= 0) & (b2 >= 0) & (b1 + b2 <= 1)
        z = triangle[0, 2] + b1 * (triangle[1, 2] - triangle[0, 2]) + b2 * (triangle[2, 2] - triangle[0, 2])
        found.append(((x * size[1] + y)[met], z[met]))
    return np.concatenate([c for c, _ in found]), np.concatenate([z for _, z in found])
