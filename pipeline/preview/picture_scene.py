"""Rendered pictures (.exr) with an exposure, and meshes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .part import bounds_of
from .scene import Picture, Scene, Triangles, count_text, size_text

if TYPE_CHECKING:
    from weft.fiber_model.yarns.garments.surface_mesh import SurfaceMesh


def picture_scene(path: Path, *, exposure: float = 0.0) -> Scene:
    """The channels R, G, B of a linear picture, brightened by `exposure` stops, as sRGB."""
    from weft.renderer.image import read_rgb, srgb

    radiance = read_rgb(path)
    levels = np.rint(srgb(radiance * 2.0**exposure) * 255).astype(np.uint8)
    height, width, _ = levels.shape
    bad = int((~np.isfinite(radiance)).any(axis=2).sum())
    return Scene(
        kind="picture",
        title=f"{path.name}: {width} x {height} pixels, exposure {exposure:+g} stops",
        layers=(Picture(levels),),
        bounds=np.array([[0.0, 0.0, 0.0], [width, height, 0.0]]),
        notes=(f"{count_text(bad, 'pixel')} not finite, shown black or white",) if bad else (),
        in_mm=False,
    )


def mesh_scene(name: str, mesh: SurfaceMesh) -> Scene:
    """The triangles of a garment."""
    bounds = bounds_of(mesh.vertices)
    summary = f"mesh of {mesh.face_count:,} triangles, {len(mesh.vertices):,} vertices, {size_text(bounds)}"
    with_uv = "with (u, v)" if mesh.uv is not None else "without (u, v)"
    return Scene("mesh", f"{name}: {summary}, {with_uv}", (Triangles(mesh.vertices, mesh.faces),), bounds)
