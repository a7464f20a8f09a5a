"""`weft run`, and a command per stage."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from .app import app
from .options import (
    NO_FRAME_OPTIONS,
    NO_JOB_OPTIONS,
    NO_RUN_OPTIONS,
    FrameOptions,
    JobOptions,
    RunOptions,
)
from .plain import run_stage
from .render_options import (
    NO_CLUSTER_OPTIONS,
    NO_PICTURE_OPTIONS,
    NO_SHARE_OPTIONS,
    ClusterOptions,
    PictureOptions,
    ShareOptions,
)


@app.command
def run(
    job: Path,
    *,
    picture: PictureOptions = NO_PICTURE_OPTIONS,
    options: JobOptions = NO_JOB_OPTIONS,
    how: RunOptions = NO_RUN_OPTIONS,
    frames: str | None = None,
    cluster: ClusterOptions = NO_CLUSTER_OPTIONS,
) -> None:
    """Run the stages of a job that are stale, say why, and skip the rest.

    Parameters
    ----------
    job
        The TOML file of the job.
    frames
        Frames of a sequence, FIRST:LAST or FIRST:LAST:STEP, both ends made: 1:10. Results: OUTPUT/frame_0001.
    """
    from weft.pipeline.config import load
    from weft.pipeline.fit_stage import run_fit_first
    from weft.pipeline.frames import frame_numbers, keep_picture, warning_of_turning
    from weft.pipeline.pictures_of import jobs_of_pictures, picture_files
    from weft.pipeline.progress import reporter
    from weft.pipeline.run import run_chain
    from weft.pipeline.stages import CHAIN, targets

    report = reporter(how.progress)
    overrides = (*options.overrides, *picture.overrides())
    fitted = run_fit_first(job, overrides, options.output, report=report, force=how.force)
    numbers: list[int | None] = [None] if frames is None else [*frame_numbers(frames)]
    if cluster.cluster is not None:
        from weft.pipeline.cluster import ClusterWork, run_on_cluster

        work = ClusterWork(
            job,
            overrides,
            options.output,
            tuple(numbers),
            cluster.blocks_per_task,
            cluster.voxel_parts,
        )
        run_on_cluster(work, cluster.cluster, jobs=cluster.jobs, report=report)
        return
    before = None
    for number, frame in enumerate(numbers):
        if frame is not None:
            report.note(f"frame {frame}")
        loaded = load(job, overrides, options.output, frame=frame)
        if number == 1 and (warning := warning_of_turning(before, loaded.config.yarns)):
            report.note(warning)
        before = loaded.config.yarns
        names = [name for name in targets(loaded) if not (fitted and name == "fit")]
        run_chain(loaded, CHAIN, names, report=report, force=how.force, resume=how.resume)
        if frame is not None and "render" in names:
            keep_picture(loaded, [files["image"] for files in map(picture_files, jobs_of_pictures(loaded))])


def _run_stage(
    name: str, job: Path, options: JobOptions, how: RunOptions, sequence: FrameOptions = NO_FRAME_OPTIONS
) -> None:
    run_stage(
        name,
        job,
        options.overrides,
        options.output,
        force=how.force,
        resume=how.resume,
        progress=how.progress,
        frame=sequence.frame,
    )


@app.command
def yarns(
    job: Path,
    *,
    options: JobOptions = NO_JOB_OPTIONS,
    how: RunOptions = NO_RUN_OPTIONS,
    sequence: FrameOptions = NO_FRAME_OPTIONS,
) -> None:
    """Make the centerlines: read them, or weave or knit them. Writes yarns.npz.

    Parameters
    ----------
    job
        The TOML file of the job.
    """
    _run_stage("yarns", job, options, how, sequence)


@app.command
def fibers(
    job: Path,
    *,
    options: JobOptions = NO_JOB_OPTIONS,
    how: RunOptions = NO_RUN_OPTIONS,
    sequence: FrameOptions = NO_FRAME_OPTIONS,
) -> None:
    """Export the part of the fibers that [export] chooses, as curves. Writes fibers.npz or fibers.obj.

    Parameters
    ----------
    job
        The TOML file of the job.
    """
    _run_stage("fibers", job, options, how, sequence)


@app.command
def voxelize(
    job: Path,
    *,
    plan: Annotated[bool, Parameter(negative=())] = False,
    part: str | None = None,
    options: JobOptions = NO_JOB_OPTIONS,
    how: RunOptions = NO_RUN_OPTIONS,
    sequence: FrameOptions = NO_FRAME_OPTIONS,
) -> None:
    """Make the sparse grid of fiber density and direction. Writes volume.vdb or volume.nvdb.

    Parameters
    ----------
    job
        The TOML file of the job.
    plan
        Only say how many bricks and bytes it will make and how long that will take.
    part
        Finish only every n-th tile from the k-th, as in 3/8; several machines may do so at once, and the run
        that finishes the volume takes what they made.
    """
    if part is not None:
        from weft.pipeline.config import load
        from weft.pipeline.volume_parts import make_volume_part

        print(make_volume_part(load(job, options.overrides, options.output, frame=sequence.frame), part))
        return
    if plan:
        from weft.pipeline.config import load
        from weft.pipeline.stages import plan_volume

        for line in plan_volume(load(job, options.overrides, options.output, frame=sequence.frame)):
            print(line)
        return
    _run_stage("voxelize", job, options, how, sequence)


@app.command
def fit(job: Path, *, options: JobOptions = NO_JOB_OPTIONS, how: RunOptions = NO_RUN_OPTIONS) -> None:
    """Fit scattering parameters to measurements. Writes fit.json and its report; looks at [fit] alone.

    Parameters
    ----------
    job
        The TOML file of the job.
    """
    from weft.pipeline.config import load
    from weft.pipeline.fit_stage import FIT, FIT_TABLES
    from weft.pipeline.progress import reporter
    from weft.pipeline.run import run_one

    loaded = load(job, options.overrides, options.output, only=FIT_TABLES)
    run_one(loaded, {"fit": FIT}, "fit", report=reporter(how.progress), force=how.force)


@app.command
def render(
    job: Path,
    *,
    picture: PictureOptions = NO_PICTURE_OPTIONS,
    part: ShareOptions = NO_SHARE_OPTIONS,
    cluster: ClusterOptions = NO_CLUSTER_OPTIONS,
    options: JobOptions = NO_JOB_OPTIONS,
    how: RunOptions = NO_RUN_OPTIONS,
    sequence: FrameOptions = NO_FRAME_OPTIONS,
) -> None:
    """Render the volume that is there. Writes image.exr and image.png, or a share of them.

    Parameters
    ----------
    job
        The TOML file of the job.
    """
    overrides = (*options.overrides, *picture.overrides())
    asked = replace(options, overrides=overrides)
    if cluster.cluster is not None:
        from weft.pipeline.cluster import ClusterWork, render_on_cluster
        from weft.pipeline.progress import reporter

        work = ClusterWork(
            job, overrides, options.output, (sequence.frame,), cluster.blocks_per_task, cluster.voxel_parts
        )
        render_on_cluster(work, cluster.cluster, jobs=cluster.jobs, report=reporter(how.progress))
        return
    if part.blocks is None and part.tiles is None:
        _run_stage("render", job, asked, how, sequence)
        return
    from weft.pipeline.config import load
    from weft.pipeline.progress import reporter
    from weft.pipeline.shares import render_shares

    render_shares(
        load(job, asked.overrides, asked.output, frame=sequence.frame),
        blocks=part.blocks,
        tiles=part.tiles,
        tile_size=part.tile_size,
        share=part.share,
        resume=how.resume,
        report=reporter(how.progress),
    )
