"""Rendered pictures (.exr) with an exposure, and meshes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from weft.files.errors import InputError

from .part import bounds_of
from .scene import Picture, Scene, Triangles, count_text, size_text


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


def mesh_scene(path: Path, *, scale_to_mm: float) -> Scene:
    """The triangles of an .obj or .ply file."""
    import trimesh

    try:
        mesh = trimesh.load(path, force="mesh", process=False)
        points = np.asarray(mesh.vertices, np.float64).reshape(-1, 3) * scale_to_mm
        faces = np.asarray(mesh.faces, np.int64).reshape(-1, 3)
    except Exception as error:  # damaged meshes make trimesh raise nearly anything
        raise InputError(f"cannot be read as a mesh: {error}", path=path) from error
    if not len(faces) or not np.isfinite(points).all():
        raise InputError("holds no triangles, or vertices that are not finite", path=path)
    bounds = bounds_of(points)
    summary = f"mesh of {len(faces):,} triangles, {len(points):,} vertices, {size_text(bounds)}"
    return Scene("mesh", f"{path.name}: {summary}", (Triangles(points, faces),), bounds)
