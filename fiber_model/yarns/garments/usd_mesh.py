"""Reader of UsdGeom meshes, through usd-core, an extra of its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from weft.fiber_model.yarns.formats.bcc import turned_to_y_up
from weft.fiber_model.yarns.formats.usd_curves import read_in_process, unit_in_mm, upward_axis


def read_usd_mesh(
    path: Path, *, scale_to_mm: float | None = None, up_axis: int = 1, frame: int | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """All meshes of a stage in the world, in mm and y up: vertices, triangles, (u, v) per corner or None.

    `scale_to_mm` replaces the stage's metersPerUnit; `up_axis`, 1 or 2, is that of a stage that names none.
    `frame`: the time code to read at; unset, what the stage says without one.
    """
    fields = read_in_process(path, f"{__package__}.usd_mesh_stage", "-" if frame is None else str(frame))
    scale = unit_in_mm(fields, scale_to_mm, path)
    vertices = turned_to_y_up(fields["vertices"], upward_axis(fields, up_axis, path)) * scale
    return vertices, fields["faces"], fields.get("uv")
