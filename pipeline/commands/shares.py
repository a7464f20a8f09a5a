"""`weft merge` and `weft submit`: pictures that machines render apart."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from weft.files.errors import InputError

from .app import app
from .options import NO_JOB_OPTIONS, JobOptions


@app.command
def merge(
    shares: list[Path],
    /,
    *,
    out: Annotated[Path, Parameter(name=("--out", "-o"))],
    partial: Annotated[bool, Parameter(negative=())] = False,
) -> None:
    """Join shares or checkpoints of one picture, in any order, to the bits that one run would have made.

    Parameters
    ----------
    shares
        Files that `weft render --blocks … --tiles …` wrote.
    out
        The .exr to write, and a .png beside it.
    partial
        Write the picture also where samples are missing.
    """
    from weft.pipeline.shares import merge_files

    print(merge_files(shares, out, partial=partial))


@app.command
def submit(
    job: Path,
    *,
    openjd: Path,
    blocks_per_task: int = 4,
    frames: str | None = None,
    options: JobOptions = NO_JOB_OPTIONS,
) -> None:
    """Write a job as an Open Job Description template, which render farms and `openjd run` take.

    Parameters
    ----------
    job
        The TOML file of the job.
    openjd
        The .json to write.
    blocks_per_task
        Blocks of render.block_samples samples that a task renders.
    frames
        Frames of a sequence, FIRST:LAST, both made.
    """
    from weft.pipeline.config import load
    from weft.pipeline.frames import frame_numbers
    from weft.pipeline.openjd import write_template

    if options.overrides:
        raise InputError("submit: the workers read the job file, not --set.", hint="Write it into the job.")
    numbers = [] if frames is None else frame_numbers(frames)
    first = load(job, (), options.output, frame=numbers[0] if numbers else None)
    print(write_template(first, openjd, blocks_per_task=blocks_per_task, frames=numbers))
