"""Surface coordinates for a mesh without any: cut into charts and flattened by xatlas, an optional extra."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from weft.files.errors import InputError

from .surface_mesh import SurfaceMesh

MAX_COST = 8.0
"""How unlike its neighbors a triangle may be and still belong to a chart; xatlas's own 2 makes more."""
NORMAL_DEVIATION_WEIGHT = 0.5
"""Weight of bending in that cost; cloth bends freely, so a quarter of xatlas's own."""


def unwrap(mesh: SurfaceMesh) -> SurfaceMesh:
    """The mesh with charts cut by xatlas, in mm as far as flattening allows (see the garment's stretch)."""
    xatlas = _xatlas()
    atlas = xatlas.Atlas()
    atlas.add_mesh(mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32))
    charts = xatlas.ChartOptions()
    charts.max_cost, charts.normal_deviation_weight = MAX_COST, NORMAL_DEVIATION_WEIGHT
    packing = xatlas.PackOptions()
    packing.rotate_charts = False
    packing.padding = 1
    atlas.generate(chart_options=charts, pack_options=packing, verbose=False)
    _, faces, uv = atlas[0]
    if len(faces) != mesh.face_count:
        raise InputError(f"xatlas kept {len(faces)} of {mesh.face_count} triangles; mend the mesh")
    # (u, v) come as parts of the atlas, whose sides differ
    texels = uv.astype(np.float64) * np.array([atlas.width, atlas.height])
    return replace(mesh, uv=texels[faces.astype(np.int64)], uv_unit_mm=None)


def _xatlas() -> Any:
    try:
        import xatlas
    except ImportError:
        raise InputError(
            "this mesh has no surface coordinates (UVs), and cutting them automatically needs xatlas.",
            hint="Install it with: pip install xatlas",
        ) from None
    return xatlas
