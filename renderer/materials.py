"""Materials as rows of four floats, in the layout of shaders/surface/: numbers, textures, measured tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from weft.files.errors import InputError

from .measured_surface import VIEWS, MeasuredSurface, read_measured_surface
from .surface_config import Material, MerlMaterial, PrincipledMaterial

MATERIAL_ROWS = 5
PRINCIPLED = (
    ("subsurface", "metallic", "specular", "specular_tint"),
    ("roughness", "anisotropic", "sheen", "sheen_tint"),
    ("clearcoat", "clearcoat_gloss"),
)
"""Rows 2 to 4 of a principled material."""
KINDS = {"diffuse": 0, "principled": 1, "merl": 2}
"""Third number of row 4."""
NO_TEXTURE = 0xFFFFFFFF


@dataclass(frozen=True)
class MaterialKinds:
    """What the kernel has to be able to do."""

    textured: bool = False
    principled: bool = False
    measured: bool = False

    @property
    def bsdf(self) -> str:
        """The piece surface/bsdf_*.glsl."""
        return "mixed" if self.principled or self.measured else "diffuse"

    @property
    def constants(self) -> dict[str, bool | int]:
        chosen: dict[str, bool | int] = {
            "SURFACE_TEXTURES": self.textured,
            "SURFACE_PRINCIPLED": self.principled,
        }
        if self.bsdf == "mixed":
            chosen["SURFACE_MEASURED"] = self.measured
        return chosen | ({"MERL_VIEWS": VIEWS} if self.measured else {})


def material_kinds(materials: Sequence[Material]) -> MaterialKinds:
    return MaterialKinds(
        any(getattr(material, "texture", None) for material in materials),
        any(isinstance(material, PrincipledMaterial) for material in materials),
        any(isinstance(material, MerlMaterial) for material in materials),
    )


@dataclass
class _Files:
    """Textures and measured tables, each once."""

    texels: list[np.ndarray] = field(default_factory=list)
    places: dict[Path, tuple[int, int, int]] = field(default_factory=dict)
    tables: dict[Path, tuple[int, MeasuredSurface]] = field(default_factory=dict)

    def texture(self, path: Path) -> tuple[int, int, int]:
        """First texel, width, height."""
        if path not in self.places:
            texels = read_texture(path)
            height, width = texels.shape
            self.places[path] = (sum(p.size for p in self.texels), width, height)
            self.texels.append(texels)
        return self.places[path]

    def table(self, path: Path) -> tuple[int, MeasuredSurface]:
        """First row, and the table."""
        if path not in self.tables:
            first = sum(len(table.rows) for _, table in self.tables.values())
            self.tables[path] = first, read_measured_surface(path)
        return self.tables[path]


def material_rows(materials: Sequence[Material]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Materials, texels four to a row, measured tables; float32, shape [n, 4] each.

    A material: (color, 0), (first texel, width, height, 0), what `PRINCIPLED` says or (first row of the
    table, ...), with its kind as the third number of row 4.
    """
    rows = np.zeros((len(materials), MATERIAL_ROWS, 4), np.float32)
    files = _Files()
    for row, material in zip(rows, materials, strict=True):
        row[1, 0] = float_bits(np.array(NO_TEXTURE))
        row[4, 2] = KINDS[material.kind]
        if isinstance(material, MerlMaterial):
            first, table = files.table(material.file)
            row[0, :3], row[2, 0] = table.albedo, float_bits(np.array(first))
            continue
        row[0, :3] = material.color
        if isinstance(material, PrincipledMaterial):
            for values, names in zip(row[2:], PRINCIPLED, strict=True):
                values[: len(names)] = [getattr(material, name) for name in names]
        if material.texture is not None:
            row[1, :3] = float_bits(np.array(files.texture(material.texture)))
    flat = np.concatenate([np.zeros(0, np.uint32), *(p.ravel() for p in files.texels)])
    padded = np.concatenate([flat, np.zeros(-len(flat) % 4, np.uint32)])
    tables = [np.zeros((0, 4), np.float32), *(table.rows for _, table in files.tables.values())]
    return rows.reshape(-1, 4), padded.view(np.float32).reshape(-1, 4), np.concatenate(tables)


def check_texture(path: Path) -> tuple[int, int]:
    """Width and height, from the header. Raises `InputError` as `read_texture`."""
    from PIL import Image

    if not Path(path).is_file():
        raise InputError("no such file.", path=path)
    try:
        with Image.open(path) as picture:
            return picture.size
    except (OSError, ValueError, Image.DecompressionBombError) as error:
        raise InputError(f"not a readable picture: {error}.", path=path) from error


def read_texture(path: Path) -> np.ndarray:
    """sRGB texels, red in the lowest byte, uint32, shape [height, width], the first row at v = 0."""
    from PIL import Image

    if not Path(path).is_file():
        raise InputError("no such file.", path=path)
    try:
        with Image.open(path) as picture:
            rgb = np.asarray(picture.convert("RGB"), np.uint32)[::-1]
    except (OSError, ValueError, Image.DecompressionBombError) as error:
        raise InputError(f"not a readable picture: {error}.", path=path) from error
    return np.ascontiguousarray(rgb[..., 0] | rgb[..., 1] << 8 | rgb[..., 2] << 16)


def float_bits(values: np.ndarray) -> np.ndarray:
    """Whole numbers as the floats that hold their bits."""
    return np.asarray(values).astype(np.uint32).view(np.float32)
