"""`weft check`: what a job would do and whether its inputs are sound, without running a stage."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from weft.files.errors import InputError

from .cache import stage_key, why_stale
from .camera_voxels import sized_by_camera
from .job import Job
from .messages import placed_in, shown
from .run import input_files, needed
from .stages import CHAIN, refuse_unknown_types, refuse_unwritable_formats, targets

if TYPE_CHECKING:
    from weft.fiber_model.fibers import FiberSet
    from weft.fiber_model.yarns.yarns import YarnSet

CHEAP_YARN_LENGTH_MM = 50_000.0
"""Up to this, laying out the fibers for the memory estimate takes a few seconds."""


def check_job(job: Job, *, fit_first: bool = False) -> Iterator[str]:
    """Lines about the job. Raises `InputError` for what the run would refuse.

    `fit_first`: [scattering] holds stand-ins for values that the job's fit has yet to find.
    """
    with placed_in(job.document):
        lines = list(_checked(job, needed(job, CHAIN, targets(job)), fit_first))
    yield f"{shown(job.path)}: no mistakes found"
    yield from lines


def _checked(job: Job, names: list[str], fit_first: bool) -> Iterator[str]:
    yield f"results in {shown(job.output)}: {', '.join(names)}"
    if "voxelize" in names:
        refuse_unwritable_formats(job)
    if "yarns" in names:
        from weft.fiber_model.yarns.catmull_rom import yarn_lengths

        yarns = _yarns(job)
        length, types = yarn_lengths(yarns).sum() / 1000, " and ".join(yarns.type_names)
        yield f"yarns: {yarns.yarn_count:,} yarns, {length:.3g} m of {types}"
        _check_types(job, yarns)
        if "voxelize" in names:
            yield from _memory(job, yarns)
    if "render" in names:
        yield from _environments(job)
        yield from _surfaces(job)
    for name in names:
        parts = CHAIN[name].parts(job)
        for part in parts:
            files = f" {next(iter(CHAIN[name].outputs(part).values()))}" if len(parts) > 1 else ""
            waits = fit_first and name in ("scattering", "render")
            yield f"{name}{files}: {'would run, after the fit' if waits else _state(part, name)}"


def _yarns(job: Job) -> YarnSet:
    """Reading or making yarns is quick, and finds what is wrong with their file."""
    from weft.fiber_model.yarns.build import run

    return run(job.table("yarns"))


def _check_types(job: Job, yarns: YarnSet) -> None:
    if job.has("scattering"):
        refuse_unknown_types(job, list(job.table("scattering").by_type), yarns.type_names)


def _memory(job: Job, yarns: YarnSet) -> Iterator[str]:
    """Refuses a grid that would not fit, where finding out takes seconds at most."""
    from weft.fiber_model.yarns.catmull_rom import yarn_lengths

    if yarn_lengths(yarns).sum() > CHEAP_YARN_LENGTH_MM:
        yield "voxelize: memory is estimated when it runs (long yarns)"
        return
    from weft.fiber_model.fibers import run

    from .warp_start import start_warp

    start_warp()
    fibers = run(job.table("fibers"), yarns)
    yield from (f"fibers: {warning}" for warning in fibers.report.warnings)
    yield f"voxelize: {_estimate(job, fibers)}"


def _estimate(job: Job, fibers: FiberSet) -> str:
    """At most how much memory the grid takes. Raises `InputError` where that is more than there is."""
    from weft.voxelize.memory import BRICK_BYTES, fit_tiles
    from weft.voxelize.plan import brick_bound, checked_region
    from weft.voxelize.sources import FiberSource

    source = FiberSource(fibers)
    config = sized_by_camera(job, fibers).sized(source.fiber_radius_mm)
    bricks = brick_bound(config, source, checked_region(config, source))
    fit_tiles(
        bricks,
        voxel_size_mm=config.size_mm,
        tile_voxels=config.tile_voxels,
        workers=1,
        memory_mb=config.memory_mb,
    )
    return f"at most {bricks:,.0f} bricks, {bricks * BRICK_BYTES / 2**20:,.0f} MiB"


def _environments(job: Job) -> Iterator[str]:
    """Read the pictures that light the scene."""
    from weft.renderer.environment import load_environment

    for light in job.table("render").lights:
        if light.kind == "environment":
            height, width, _ = load_environment(light.file).shape
            yield f"render: {shown(light.file)} is {width} x {height}"


def _surfaces(job: Job) -> Iterator[str]:
    """Read the meshes, and as much of textures and measured tables as tells whether they can be drawn."""
    from weft.renderer.surface_files import check_surface_files

    yield from (
        f"render: {shown(path)} has {what}" for path, what in check_surface_files(job.table("render"))
    )


def _state(job: Job, name: str) -> str:
    stage = CHAIN[name]
    try:
        inputs = input_files(stage, job, CHAIN)
    except InputError:
        return "would run, after those before it"
    why = why_stale(stage, job, stage_key(stage, job, inputs))
    return f"would run because {why}" if why else "fresh"
