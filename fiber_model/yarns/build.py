"""The yarn stage: from a config to a set of yarns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from .config import FileYarnsConfig, GarmentConfig, KnitConfig, TileConfig, WeaveConfig, YarnsConfig
from .fabrics.knit import knit_yarns
from .fabrics.knit_chart import knit_chart_yarns
from .fabrics.tile import tile_yarns
from .fabrics.weave import weave_yarns
from .formats.pyp import read_pyp
from .formats.read_file import read_yarns
from .garments.garment import garment_yarns
from .garments.surface_config import MeshConfig
from .steady_frames import follow_rest
from .yarns import YarnSet

Progress = Callable[[float, str], None]


def run(config: YarnsConfig, *, progress: Progress | None = None) -> YarnSet:
    """Read or generate the yarns that `config` asks for; `save_yarns` writes them as .npz."""
    match config:
        case FileYarnsConfig():
            yarns = read_yarns(config)
        case WeaveConfig():
            yarns = _weave(config, progress)
        case KnitConfig():
            yarns = _knit(config, progress)
        case TileConfig():
            yarns = _tile(config, progress)
        case GarmentConfig():
            yarns = garment_yarns(config, run, progress=progress)
        case _:
            raise TypeError(f"not a yarn config: {config!r}")
    if (at_rest := _at_rest(config)) is not None:
        yarns = follow_rest(yarns, run(at_rest))
    if progress is not None:
        progress(1.0, f"{yarns.yarn_count:,} yarns of {yarns.point_count:,} points")
    return yarns


def _at_rest(config: YarnsConfig) -> YarnsConfig | None:
    """The config of the same yarns as they lie at rest, where it names a file that holds them."""
    rest: dict[str, object] = {"rest": None, "frame": None}
    match config:
        case FileYarnsConfig(rest=Path() as file):
            return config.model_copy(update=rest | {"file": file})
        case GarmentConfig(surface=MeshConfig(rest=Path() as file) as surface):
            at_rest = surface.model_copy(update=rest | {"file": file})
            return config.model_copy(update={"surface": at_rest})
    return None


def _weave(config: WeaveConfig, progress: Progress | None) -> YarnSet:
    return weave_yarns(
        config.size_mm,
        draft=config.draft,
        warp_per_cm=config.warp_per_cm,
        weft_per_cm=config.weft_per_cm,
        warp_radius_mm=config.warp_radius_mm,
        weft_radius_mm=config.weft_radius_mm,
        warp_crimp=config.warp_crimp,
        points_per_crossing=config.points_per_crossing,
        type_names=tuple(config.type_names),
        progress=progress,
    )


def _knit(config: KnitConfig, progress: Progress | None) -> YarnSet:
    if config.chart != "stockinette":
        return knit_chart_yarns(
            config.size_mm,
            chart=config.chart,
            stitch_width_mm=config.stitch_width_mm,
            wale_spacing_mm=config.wale_spacing_mm,
            course_spacing_mm=config.course_spacing_mm,
            radius_mm=config.radius_mm,
            type_name=config.type_name,
            progress=progress,
        )
    return knit_yarns(
        config.size_mm,
        stitch_width_mm=config.stitch_width_mm,
        course_spacing_mm=config.course_spacing_mm,
        radius_mm=config.radius_mm,
        type_name=config.type_name,
        progress=progress,
    )


def _tile(config: TileConfig, progress: Progress | None) -> YarnSet:
    tile = read_pyp(config.tile, scale_to_mm=config.scale_to_mm)
    if config.radius_mm is not None:
        tile = replace(tile, radius=config.radius_mm)
    return tile_yarns(tile, config.size_mm, type_name=config.type_name, source=config.tile, progress=progress)
