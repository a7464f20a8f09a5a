"""From a file to what a preview shows of it: by its suffix, and of a job by the part that was asked for."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from weft.files.errors import InputError
from weft.pipeline.cache import stage_key, why_stale
from weft.pipeline.messages import did_you_mean, placed_in, shown
from weft.pipeline.picture_volume import load_volume
from weft.pipeline.run import input_files
from weft.pipeline.stages import CHAIN

from .options import PreviewOptions
from .scene import Scene

if TYPE_CHECKING:
    from weft.pipeline.job import Job
    from weft.pipeline.stage import Stage
    from weft.voxelize.config import ForeignVolumeConfig


def open_scene(
    path: Path, options: PreviewOptions, *, overrides: Sequence[str] = (), output: Path | None = None
) -> Scene:
    """Raises `InputError` for what cannot be read or shown."""
    if not path.is_file():
        raise InputError("is a folder; give a file" if path.is_dir() else "no such file", path=path)
    suffix = path.suffix.lower()
    if suffix == ".toml":
        return _job(path, options, overrides, output)
    if suffix not in OPENERS:
        what = f"weft cannot show '{path.suffix}' files"
        raise InputError(what + did_you_mean(suffix, [*OPENERS, ".toml"]), path=path)
    for given, option in ((options.part, "--part"), (overrides, "--set"), (output, "--output")):
        if given:
            hint = " The picture's name is given by --out." if option == "--output" else ""
            raise InputError(f"{option} is for jobs (.toml files).{hint}", path=path)
    return OPENERS[suffix](path, options)


def _npz(path: Path, options: PreviewOptions) -> Scene:
    """Yarns, or curves of fibers."""
    from weft.fiber_model.fiber_curve_file import read_curves
    from weft.fiber_model.yarns.yarn_file import load_yarns

    from .fiber_scene import fiber_scene
    from .yarn_scene import yarn_scene

    try:
        with np.load(path, allow_pickle=False, max_header_size=10_000) as archive:
            are_yarns = "closed" in archive.files
    except Exception as error:  # damaged archives make zipfile and numpy raise nearly anything
        raise InputError("is not a readable .npz file; is it damaged?", path=path) from error
    if are_yarns:
        return yarn_scene(path.name, load_yarns(path), box=options.box_mm)
    return fiber_scene(path.name, read_curves(path), box=options.box_mm)


def _yarn_file(path: Path, options: PreviewOptions) -> Scene:
    """Yarns from a file of any kind that `weft yarns` reads; what the file does not hold must be given."""
    from weft.fiber_model.yarns.config import NOT_IN_FILE, FileYarnsConfig
    from weft.fiber_model.yarns.formats.read_file import read_yarns

    from .yarn_scene import yarn_scene

    missing = NOT_IN_FILE[path.suffix.lower()]
    config = FileYarnsConfig(
        kind="file",
        file=path,
        frame=options.frame,
        scale_to_mm=_unit(path, options) if "scale_to_mm" in missing else options.scale_to_mm,
        radius_mm=_radius(path, options) if "radius_mm" in missing else options.radius_mm,
        up_axis=options.up_axis or "y",
    )
    try:
        yarns = read_yarns(config)
    except InputError as error:
        raise _about_options(error) from error
    return yarn_scene(path.name, yarns, box=options.box_mm)


def _usd(path: Path, options: PreviewOptions) -> Scene:
    """Curves are yarns; a stage without any is a garment."""
    from weft.fiber_model.yarns.formats.usd_stage import NO_CURVES

    try:
        return _yarn_file(path, options)
    except InputError as error:
        if error.what != NO_CURVES:
            raise
    return _mesh(path, options)


def _about_options(error: InputError) -> InputError:
    """The same message, which names keys of a job, about the options of this command."""
    what, hint = (
        re.sub(
            r"'?(scale_to_mm|radius_mm|up_axis)'?", lambda key: "--" + key[1].replace("_", "-"), text or ""
        )
        for text in (error.what, error.hint)
    )
    return InputError(what, path=error.path, place=error.place, hint=hint)


def _pyp(path: Path, options: PreviewOptions) -> Scene:
    from weft.fiber_model.yarns.formats.pyp import read_pyp

    from .yarn_scene import tile_scene

    scale = 1000.0 if options.scale_to_mm is None else options.scale_to_mm
    return tile_scene(path.name, read_pyp(path, scale_to_mm=scale), box=options.box_mm)


def _obj(path: Path, options: PreviewOptions) -> Scene:
    """Polylines are yarns; a file with faces and no polylines is a garment."""
    return _mesh(path, options) if _has_faces_only(path) else _yarn_file(path, options)


def _mesh(path: Path, options: PreviewOptions) -> Scene:
    from weft.fiber_model.yarns.garments.mesh_files import read_mesh

    from .picture_scene import mesh_scene

    scale = _unit(path, options) if path.suffix.lower() in (".obj", ".ply") else options.scale_to_mm
    try:
        mesh = read_mesh(path, scale_to_mm=scale, up_axis=2 if options.up_axis == "z" else 1)
    except InputError as error:
        raise _about_options(error) from error
    return mesh_scene(path.name, mesh)


def _grid(path: Path, options: PreviewOptions, foreign: ForeignVolumeConfig | None = None) -> Scene:
    from .grid_scene import grid_scene

    volume = load_volume(path, foreign)
    return grid_scene(path.name, volume, slices=options.slices, surface=options.surface, box=options.box_mm)


def _exr(path: Path, options: PreviewOptions) -> Scene:
    from .picture_scene import picture_scene

    return picture_scene(path, exposure=options.exposure)


def _has_faces_only(path: Path) -> bool:
    with open(path, encoding="utf-8", errors="replace") as file:
        kinds = {line.split(None, 1)[0] for line in file if line[:1] in "fl" and line.strip()}
    return "f" in kinds and "l" not in kinds


def _unit(path: Path, options: PreviewOptions) -> float:
    if options.scale_to_mm is None:
        what = f"{path.suffix} files name no unit; give --scale-to-mm, the length of one unit of the file"
        raise InputError(f"{what} in mm, such as --scale-to-mm 10 for centimeters", path=path)
    return options.scale_to_mm


def _radius(path: Path, options: PreviewOptions) -> float:
    if options.radius_mm is None:
        raise InputError(f"{path.suffix} files hold no yarn radius; give --radius-mm", path=path)
    return options.radius_mm


def _job(path: Path, options: PreviewOptions, overrides: Sequence[str], output: Path | None) -> Scene:
    """Yarns and fibers are made in memory, as the job says now; a grid is taken from the job's results."""
    from weft.pipeline.config import load

    job = load(path, overrides, output)
    with placed_in(job.document):
        return JOB_PARTS[options.part or "yarns"](job, options)


def _job_yarns(job: Job, options: PreviewOptions) -> Scene:
    from weft.fiber_model.yarns.build import run

    from .yarn_scene import yarn_scene

    return yarn_scene(job.path.name, run(_table(job, "yarns")), box=options.box_mm)


def _job_fibers(job: Job, options: PreviewOptions) -> Scene:
    from weft.fiber_model.fiber_curves import FiberSelection
    from weft.fiber_model.fibers import run
    from weft.fiber_model.yarns.build import run as run_yarns
    from weft.pipeline.warp_start import start_warp

    from .fiber_scene import job_fiber_scene

    start_warp()
    fibers = run(_table(job, "fibers"), run_yarns(_table(job, "yarns")))
    selection = FiberSelection()
    if job.has("export"):
        table = job.table("export")
        selection = FiberSelection(table.yarns, table.arc_length_mm, table.box_mm)
    return job_fiber_scene(job.path.name, fibers, selection, box=options.box_mm)


def _job_grid(job: Job, options: PreviewOptions) -> Scene:
    """The grid that [render] volume names, or that [voxelize] made."""
    named = job.table("render").volume if job.has("render") else None
    if named is not None:
        return _grid(named, options, job.table("render").foreign)
    _table(job, "voxelize")
    stage = CHAIN["voxelize"]
    path = job.output / next(iter(stage.outputs(job).values()))
    if not path.is_file():
        hint = f"Run 'weft run {shown(job.path)}' first."
        raise InputError(f"{shown(path)} does not exist yet.", hint=hint)
    scene = _grid(path, options)
    why = _why_stale(job, stage)
    return replace(scene, notes=(*scene.notes, f"this grid is stale: {why}")) if why else scene


def _why_stale(job: Job, stage: Stage) -> str:
    try:
        return why_stale(stage, job, stage_key(stage, job, input_files(stage, job, CHAIN)))
    except InputError as error:
        return str(error)


def _table(job: Job, name: str) -> Any:
    if not job.has(name):
        raise InputError(f"this preview needs the table [{name}], which the job lacks", path=job.path)
    return job.table(name)


JOB_PARTS: dict[str, Callable[[Job, PreviewOptions], Scene]] = {
    "yarns": _job_yarns,
    "fibers": _job_fibers,
    "grid": _job_grid,
}
OPENERS: dict[str, Callable[[Path, PreviewOptions], Scene]] = {
    ".npz": _npz,
    **dict.fromkeys((".bcc", ".bccx", ".hair", ".mitshair", ".poly", ".yarns"), _yarn_file),
    ".pyp": _pyp,
    ".obj": _obj,
    **dict.fromkeys((".ply", ".glb", ".gltf"), _mesh),
    **dict.fromkeys((".usd", ".usda", ".usdc"), _usd),
    ".vdb": _grid,
    ".nvdb": _grid,
    ".exr": _exr,
}
