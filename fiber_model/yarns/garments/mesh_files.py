"""Readers of triangle meshes: .obj, .ply, .glb and .gltf through trimesh, USD through usd-core.

Units and the upward axis come from the file where it knows them, and else from the config.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from weft.fiber_model.yarns.formats.bcc import turned_to_y_up
from weft.files.errors import InputError

from .gltf_files import refuse_bad_gltf
from .mesh_parts import joined_parts
from .ply_files import refuse_bad_ply
from .surface_mesh import SurfaceMesh
from .usd_mesh import read_usd_mesh

GLTF_TO_MM = 1000.0
MAX_FILE_BYTES = 2 << 30


def read_mesh(
    path: str | Path,
    *,
    scale_to_mm: float | None = None,
    up_axis: int = 1,
    uv_unit_mm: float | None = None,
    frame: int | None = None,
) -> SurfaceMesh:
    """Read all meshes of a file as one; `scale_to_mm` is the length of a file unit [mm], `up_axis` 1 or 2.

    `frame`: time code of a USD file that moves.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    _refuse_large(path)
    if suffix.startswith(".usd"):
        vertices, faces, uv = read_usd_mesh(path, scale_to_mm=scale_to_mm, up_axis=up_axis, frame=frame)
    else:
        if suffix in (".glb", ".gltf"):
            refuse_bad_gltf(path)
        if suffix == ".ply":
            refuse_bad_ply(path)
        vertices, faces, uv = _read_with_trimesh(path)
        if scale_to_mm is None and suffix in (".obj", ".ply"):
            raise InputError("needs scale_to_mm: these files do not hold their unit", path=path)
        vertices = turned_to_y_up(vertices, up_axis) * (scale_to_mm or GLTF_TO_MM)
    return SurfaceMesh.checked(vertices, faces, uv, uv_unit_mm=uv_unit_mm, source=path)


def _refuse_large(path: Path) -> None:
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise InputError("over 2 GiB; too large for a garment's mesh", path=path)
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", path=path) from None


def _read_with_trimesh(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Vertices in file units, triangles, and (u, v) per corner where every part of the file has them."""
    import trimesh

    try:
        scene = trimesh.load_scene(path, process=False, maintain_order=True, skip_materials=True)
        parts = [part for part in scene.dump(concatenate=False) if isinstance(part, trimesh.Trimesh)]
    except Exception as error:  # the readers raise nearly anything on damaged files
        raise InputError(
            f"cannot be read as a mesh ({type(error).__name__}); is it damaged?", path=path
        ) from error
    if not parts:
        raise InputError("there is no triangle mesh in this file", path=path)
    return joined_parts(
        [(np.asarray(part.vertices), np.asarray(part.faces), _corner_uv(part, path)) for part in parts]
    )


def _corner_uv(part: Any, path: Path) -> np.ndarray | None:
    """(u, v) of each corner of each triangle of a trimesh, shape [n, 3, 2], or None."""
    uv = getattr(part.visual, "uv", None)
    if uv is None or len(uv) != len(part.vertices) or len(uv) == 0:
        return None
    if part.faces.min() < 0 or part.faces.max() >= len(uv):
        raise InputError(f"triangles name vertices that there are not; there are {len(uv)}", path=path)
    return np.asarray(uv, dtype=np.float64)[part.faces][..., :2]
