"""Whether the files that a scene's surfaces name can be drawn, at the price of reading them once."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from weft.files.measured.merl import check_merl_header

from .config import RenderConfig
from .light_config import MeshLight
from .materials import check_texture
from .mesh import load_mesh
from .surface_config import MerlMaterial, MeshSurface, Stencil


def check_surface_files(config: RenderConfig) -> Iterator[tuple[Path, str]]:
    """Each file and what it holds. Raises `InputError` for what is missing or not what it should be.

    Meshes are read whole; of textures and measured tables the header and the size.
    """
    known: set[Path] = set()
    for surface in (*config.surfaces, *config.lights, config.stencil):
        for path, kind in _files(surface):
            if path in known:
                continue
            known.add(path)
            yield path, _content(path, kind)


def _files(surface: object) -> Iterator[tuple[Path, str]]:
    if isinstance(surface, MeshSurface | MeshLight | Stencil):
        yield surface.file, "mesh"
    material = getattr(surface, "material", None)
    if isinstance(material, MerlMaterial):
        yield material.file, "merl"
    elif texture := getattr(material, "texture", None):
        yield texture, "texture"


def _content(path: Path, kind: str) -> str:
    if kind == "mesh":
        return f"{len(load_mesh(path)):,} triangles"
    if kind == "merl":
        check_merl_header(path)
        return "a measured BRDF"
    width, height = check_texture(path)
    return f"{width} x {height} pixels"
