"""Looking at files: `weft check`, `weft inspect` and `weft preview`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from .app import app
from .options import (
    NO_FRAME_OPTIONS,
    NO_JOB_OPTIONS,
    NO_LOOK_OPTIONS,
    NO_UNIT_OPTIONS,
    FrameOptions,
    JobOptions,
    LookOptions,
    UnitOptions,
)


@app.command
def check(
    job: Path, *, options: JobOptions = NO_JOB_OPTIONS, sequence: FrameOptions = NO_FRAME_OPTIONS
) -> None:
    """Say what is wrong with a job, or what it would do, without running it.

    Parameters
    ----------
    job
        The TOML file of the job.
    """
    from weft.pipeline.check import check_job
    from weft.pipeline.config import load
    from weft.pipeline.fit_stage import fit_to_come

    pending = fit_to_come(job, options.overrides, options.output)
    loaded = load(job, options.overrides, options.output, pending_fit=pending, frame=sequence.frame)
    for line in check_job(loaded, fit_first=pending is not None):
        print(line)


@app.command
def inspect(
    file: Path,
    *,
    verify: Annotated[bool, Parameter(negative=())] = False,
    json: Annotated[bool, Parameter(negative=())] = False,
) -> None:
    """Say what is in a file: yarns, volume, image, job or run record.

    Parameters
    ----------
    file
        A .npz, .bcc, .bccx, .hair, .mitshair, .obj, .poly, .pyp, .usd, .yarns, .vdb, .nvdb, .exr, .png,
        .toml or .run.json file.
    verify
        Also compare the content with the hash in the file and in the run record beside it.
    json
        One JSON object in place of the lines.
    """
    from weft.pipeline.inspection.describe import describe

    for line in describe(file, verify=verify, as_json=json):
        print(line)


@app.command
def preview(
    files: list[Path],
    /,
    *,
    out: Path | None = None,
    look: LookOptions = NO_LOOK_OPTIONS,
    units: UnitOptions = NO_UNIT_OPTIONS,
    options: JobOptions = NO_JOB_OPTIONS,
) -> None:
    """Show yarns, fibers, garments, grids and pictures in a window, or as a PNG where there is no display.

    Parameters
    ----------
    files
        One file, or up to six side by side: .npz .bcc .bccx .hair .mitshair .obj .poly .pyp .usd .yarns .ply
        .glb .gltf .vdb .nvdb .exr, or a job (.toml).
    out
        The PNG to write in place of opening a window.
    """
    from weft.pipeline.preview.options import preview_options
    from weft.pipeline.preview.preview import preview as show

    asked = preview_options(look, units)
    for line in show(
        files,
        asked,
        out=out,
        size=look.size,
        view=look.view,
        overrides=options.overrides,
        output=options.output,
    ):
        print(line)
