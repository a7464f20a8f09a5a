"""The garment of a [yarns] table: its surface, its charts, its pattern, and the yarns laid on it."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from weft.fiber_model.yarns.config import (
    FileYarnsConfig,
    GarmentConfig,
    KnitPattern,
    TilePattern,
    WeavePattern,
)
from weft.fiber_model.yarns.fabrics.drafts import draft_matrix
from weft.fiber_model.yarns.fabrics.knit import COURSE_PER_WALE
from weft.fiber_model.yarns.fabrics.weave import weave_parts
from weft.fiber_model.yarns.formats.pyp import read_pyp
from weft.fiber_model.yarns.yarns import YarnSet
from weft.files.errors import InputError

from .charts import build_charts
from .garment_shapes import scarf_mesh, sleeve_mesh
from .mesh_files import read_mesh
from .on_mesh import FlatPattern, lay_on_mesh
from .panels import cut_panels
from .surface_config import MeshConfig, ScarfConfig, SleeveConfig
from .surface_mesh import SurfaceMesh
from .unwrap import unwrap

Pattern = WeavePattern | KnitPattern | TilePattern | FileYarnsConfig
Progress = Callable[[float, str], None]


def garment_yarns(
    config: GarmentConfig, make_flat: Callable[[Pattern], YarnSet], *, progress: Progress | None = None
) -> YarnSet:
    """Lay the pattern on the surface; `make_flat` makes the yarns of a pattern's config."""
    mesh, unwrapped = surface_mesh(config.surface)
    grain = config.grain if config.grain != "auto" else "up" if unwrapped else "uv"
    charts = build_charts(mesh, scale=config.scale, grain=grain)
    try:
        return lay_on_mesh(
            mesh,
            charts,
            flat_pattern(config.pattern, make_flat),
            offset_mm=config.offset_mm,
            join_seams=config.join_seams,
            hem_mm=config.hem_mm,
            region_mm=None if config.region_mm is None else np.array(config.region_mm),
            progress=progress,
        )
    except InputError as error:
        path = config.surface.file if isinstance(config.surface, MeshConfig) else None
        raise InputError(error.what, path=error.path or path, place=error.place, hint=error.hint) from None


def surface_mesh(config: MeshConfig | SleeveConfig | ScarfConfig) -> tuple[SurfaceMesh, bool]:
    """The mesh, with surface coordinates, and whether those were made here."""
    match config:
        case SleeveConfig():
            return sleeve_mesh(**config.model_dump(exclude={"kind"})), False
        case ScarfConfig():
            return scarf_mesh(**config.model_dump(exclude={"kind"})), False
        case MeshConfig():
            return _mesh_from_file(config)


def _mesh_from_file(config: MeshConfig) -> tuple[SurfaceMesh, bool]:
    mesh = read_mesh(
        config.file,
        scale_to_mm=config.scale_to_mm,
        up_axis={None: 1, "y": 1, "z": 2}[config.up_axis],
        uv_unit_mm=config.uv_unit_mm,
        frame=config.frame,
    )
    if config.uv == "file" and mesh.uv is None:
        raise InputError(
            "this mesh has no surface coordinates (UVs).",
            path=config.file,
            hint="Set yarns.surface.uv = 'unwrap' to cut them automatically.",
        )
    if config.uv in ("unwrap", "panels") or mesh.uv is None:
        try:
            return (cut_panels if config.uv == "panels" else unwrap)(mesh), True
        except InputError as error:
            raise InputError(error.what, path=config.file, hint=error.hint) from None
    return mesh, False


def _weave_parts(
    config: WeavePattern,
) -> Callable[[tuple[float, float], np.ndarray | None], Iterator[YarnSet]]:
    options = config.model_dump(exclude={"kind", "size_mm", "type_names"})
    names = tuple(config.type_names)
    return lambda size, within: weave_parts(size, type_names=names, within=within, **options)


def flat_pattern(config: Pattern, make_flat: Callable[[Pattern], YarnSet]) -> FlatPattern:
    """The pattern as a function of its size, with its period and the loose arcs that may come of cutting."""

    def make(size: tuple[float, float]) -> YarnSet:
        update = {} if isinstance(config, FileYarnsConfig) else {"size_mm": size}
        return make_flat(config.model_copy(update=update))

    match config:
        case KnitPattern():
            width = config.stitch_width_mm
            course = config.course_spacing_mm or COURSE_PER_WALE * width
            return FlatPattern(np.array([width, course]), make, least_piece_mm=width)
        case WeavePattern():
            rows, columns = draft_matrix(config.draft).shape
            period = 10 * np.array([columns / config.warp_per_cm, rows / config.weft_per_cm])
            return FlatPattern(period, make, make_parts=_weave_parts(config))
        case TilePattern():
            period = read_pyp(config.tile, scale_to_mm=config.scale_to_mm).period
            return FlatPattern(period, make, least_piece_mm=float(period.max()))
        case FileYarnsConfig():
            return FlatPattern(np.zeros(2), make)
