"""Meshes of one USD file as plain arrays; a program of its own, run by `usd_mesh` as `usd_stage` for curves.

Arguments: the USD file, the .npz file to write, and the time code to read at, or "-" for none. A user's
mistake is printed as one line, exit code 2.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

from weft.fiber_model.yarns.formats.usd_stage import open_stage, unit_and_axis, write_fields
from weft.files.errors import InputError

from .mesh_parts import joined_parts

Part = tuple[np.ndarray, np.ndarray, np.ndarray | None]


def main(file: str, result: str, frame: str = "-") -> int:
    """Read meshes of `file` and write `result`; the exit code."""
    return write_fields(lambda: read_meshes(file, frame), file, result)


def read_meshes(file: str, frame: str = "-") -> dict[str, Any]:
    """Of all meshes in the world: unit, up axis, vertices, triangles, and (u, v) of each corner."""
    from pxr import Usd, UsdGeom

    stage = open_stage(file)
    prims = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    if not prims:
        raise InputError("there is no mesh on this USD stage")
    time = Usd.TimeCode.Default() if frame == "-" else Usd.TimeCode(int(frame))
    cache = UsdGeom.XformCache(time)
    vertices, faces, uv = joined_parts([_part(prim, cache, UsdGeom, time) for prim in prims])
    fields = {"vertices": vertices, "faces": faces, **unit_and_axis(stage)}
    return fields if uv is None else fields | {"uv": uv}


def _part(prim: Any, cache: Any, UsdGeom: Any, time: Any) -> Part:
    """One mesh in world coordinates of the stage, in triangles."""
    mesh = UsdGeom.Mesh(prim)
    points = np.array(mesh.GetPointsAttr().Get(time) or [], dtype=np.float64).reshape(-1, 3)
    counts = np.array(mesh.GetFaceVertexCountsAttr().Get() or [], dtype=np.int64)
    index = np.array(mesh.GetFaceVertexIndicesAttr().Get() or [], dtype=np.int64)
    if (counts < 0).any() or counts.sum() != len(index):
        raise InputError(
            f"{prim.GetPath()}: the face counts add up to {counts.sum()}, but there are {len(index)} corners",
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


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
