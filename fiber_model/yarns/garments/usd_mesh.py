"""Reader of UsdGeom meshes, through usd-core, an extra of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from weft.fiber_model.yarns.formats.bcc import turned_to_y_up
from weft.files.errors import InputError

from .mesh_files import joined_parts

Part = tuple[np.ndarray, np.ndarray, np.ndarray | None]


def read_usd_mesh(
    path: Path, *, scale_to_mm: float | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """All meshes of a stage in the world, in mm and y up: vertices, triangles, (u, v) per corner or None.

    Without `scale_to_mm` the stage's metersPerUnit counts.
    """
    Tf, Usd, UsdGeom = _usd(path)
    try:
        stage = Usd.Stage.Open(str(path))
    except Tf.ErrorException as error:
        raise InputError("cannot be read as USD; is it damaged?", path=path) from error
    prims = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    if not prims:
        raise InputError("there is no mesh on this USD stage", path=path)
    cache = UsdGeom.XformCache()
    vertices, faces, uv = joined_parts([_part(prim, cache, UsdGeom, path) for prim in prims])
    up_axis = 2 if UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z else 1
    scale = scale_to_mm or 1000.0 * UsdGeom.GetStageMetersPerUnit(stage)
    return turned_to_y_up(vertices, up_axis) * scale, faces, uv


def _usd(path: Path) -> tuple[Any, Any, Any]:
    try:
        from pxr import Tf, Usd, UsdGeom
    except ImportError:
        raise InputError(
            "USD files need usd-core.", path=path, hint="Install it with: pip install usd-core"
        ) from None
    return Tf, Usd, UsdGeom


def _part(prim: Any, cache: Any, UsdGeom: Any, path: Path) -> Part:
    """One mesh in world coordinates of the stage, in triangles."""
    mesh = UsdGeom.Mesh(prim)
    points = np.array(mesh.GetPointsAttr().Get() or [], dtype=np.float64).reshape(-1, 3)
    counts = np.array(mesh.GetFaceVertexCountsAttr().Get() or [], dtype=np.int64)
    index = np.array(mesh.GetFaceVertexIndicesAttr().Get() or [], dtype=np.int64)
    if (counts < 0).any() or counts.sum() != len(index):
        raise InputError(
            f"{prim.GetPath()}: the face counts add up to {counts.sum()}, but there are {len(index)} corners",
            path=path,
        )
    corners = fan_corners(counts)
    if mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded:
        corners = corners[:, ::-1]
    matrix = np.array(cache.GetLocalToWorldTransform(prim))  # row vectors: p' = p M
    if np.linalg.det(matrix[:3, :3]) < 0:
        corners = corners[:, ::-1]
    uv = _corner_uv(prim, UsdGeom, index, len(points))
    return points @ matrix[:3, :3] + matrix[3, :3], index[corners], None if uv is None else uv[corners]


def fan_corners(counts: np.ndarray) -> np.ndarray:
    """Triangles of polygons with these corner counts, as numbers of corners, shape [n, 3]."""
    first = np.cumsum(counts) - counts
    triangles = np.maximum(counts - 2, 0)
    nth = np.arange(triangles.sum()) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    start = np.repeat(first, triangles)
    return np.stack([start, start + nth + 1, start + nth + 2], axis=1)


def _corner_uv(prim: Any, UsdGeom: Any, index: np.ndarray, point_count: int) -> np.ndarray | None:
    """(u, v) of each corner, from the first primvar of texture coordinates, or None."""
    for primvar in UsdGeom.PrimvarsAPI(prim).GetPrimvars():
        if "texCoord2" not in str(primvar.GetTypeName()) and primvar.GetPrimvarName() != "st":
            continue
        values = np.array(primvar.ComputeFlattened() or [], dtype=np.float64)
        if values.ndim == 2 and values.shape == (len(index), 2):
            return values
        if values.ndim == 2 and values.shape == (point_count, 2) and len(index) and index.max() < point_count:
            return values[index]
    return None
