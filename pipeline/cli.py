"""The command line. Heavy packages are imported by the command that needs them, never here."""

from __future__ import annotations

import errno
import signal
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import App, CycloptsError, Parameter

from weft.files.errors import DiskSpaceError, InputError

DONE, WRONG_INPUT, NO_SPACE, INTERRUPTED, TERMINATED = 0, 2, DiskSpaceError.exit_code, 130, 143

app = App(
    name="weft",
    help="Pictures of cloth from yarn curves: yarns, fibers, a sparse volume, scattering, path tracing.",
    version=lambda: metadata.version("weft"),
    suppress_keyboard_interrupt=False,
)


@Parameter(name="*")
@dataclass(frozen=True)
class JobOptions:
    """What every command that reads a job understands."""

    overrides: Annotated[tuple[str, ...], Parameter(name="--set", negative=())] = ()
    """Change one value of the job, as in --set render.samples_per_pixel=64. May be given several times."""
    output: Annotated[Path | None, Parameter(name=("--output", "-o"))] = None
    """Folder of the results. Default: [output] folder of the job, or JOB.out beside the job."""


@Parameter(name="*")
@dataclass(frozen=True)
class RunOptions:
    """How to run."""

    force: Annotated[bool, Parameter(negative=())] = False
    """Run even what is fresh."""
    progress: Literal["auto", "bar", "plain", "json"] = "auto"
    """Bars on a terminal and plain lines elsewhere, or one JSON object a line on standard output."""


NO_JOB_OPTIONS = JobOptions()
NO_RUN_OPTIONS = RunOptions()


@app.command
def run(job: Path, *, options: JobOptions = NO_JOB_OPTIONS, how: RunOptions = NO_RUN_OPTIONS) -> None:
    """Run the stages of a job that are stale, say why, and skip the rest.

    Parameters
    ----------
    job
        The TOML file of the job.
    """
    from .config import load
    from .fit_stage import run_fit_first
    from .progress import reporter
    from .run import run_chain
    from .stages import CHAIN, targets

    report = reporter(how.progress)
    fitted = run_fit_first(job, options.overrides, options.output, report=report, force=how.force)
    loaded = load(job, options.overrides, options.output)
    names = [name for name in targets(loaded) if not (fitted and name == "fit")]
    run_chain(loaded, CHAIN, names, report=report, force=how.force)


def _run_stage(name: str, job: Path, options: JobOptions, how: RunOptions) -> None:
    from .config import load
    from .progress import reporter
    from .run import run_one
    from .stages import CHAIN

    run_one(
        load(job, options.overrides, options.output),
        CHAIN,
        name,
        report=reporter(how.progress),
        force=how.force,
    )


@app.command
def yarns(job: Path, *, options: JobOptions = NO_JOB_OPTIONS, how: RunOptions = NO_RUN_OPTIONS) -> None:
    """Make the centerlines: read them, or weave or knit them. Writes yarns.npz.

    Parameters
    ----------
    job
        The TOML file of the job.
    """
    _run_stage("yarns", job, options, how)


@app.command
def fibers(job: Path, *, options: JobOptions = NO_JOB_OPTIONS, how: RunOptions = NO_RUN_OPTIONS) -> None:
    """Export the part of the fibers that [export] chooses, as curves. Writes fibers.npz or fibers.obj.

    Parameters
    ----------
    job
        The TOML file of the job.
    """
    _run_stage("fibers", job, options, how)


@app.command
def voxelize(
    job: Path,
    *,
    plan: Annotated[bool, Parameter(negative=())] = False,
    options: JobOptions = NO_JOB_OPTIONS,
    how: RunOptions = NO_RUN_OPTIONS,
) -> None:
    """Make the sparse grid of fiber density and direction. Writes volume.vdb or volume.nvdb.

    Parameters
    ----------
    job
        The TOML file of the job.
    plan
        Only say how many bricks and bytes it will make and how long that will take.
    """
    if plan:
        from .config import load
        from .stages import plan_volume

        for line in plan_volume(load(job, options.overrides, options.output)):
            print(line)
        return
    _run_stage("voxelize", job, options, how)


@app.command
def fit(job: Path, *, options: JobOptions = NO_JOB_OPTIONS, how: RunOptions = NO_RUN_OPTIONS) -> None:
    """Fit scattering parameters to measurements. Writes fit.json and its report; looks at [fit] alone.

    Parameters
    ----------
    job
        The TOML file of the job.
    """
    from .config import load
    from .fit_stage import FIT, FIT_TABLES
    from .progress import reporter
    from .run import run_one

    loaded = load(job, options.overrides, options.output, only=FIT_TABLES)
    run_one(loaded, {"fit": FIT}, "fit", report=reporter(how.progress), force=how.force)


@app.command
def render(job: Path, *, options: JobOptions = NO_JOB_OPTIONS, how: RunOptions = NO_RUN_OPTIONS) -> None:
    """Render the volume that is there. Writes image.exr and image.png.

    Parameters
    ----------
    job
        The TOML file of the job.
    """
    _run_stage("render", job, options, how)


@app.command(name="simulate-fiber")
def simulate_fiber(
    what: str,
    /,
    *,
    out: Path,
    shape: str | None = None,
    overrides: Annotated[tuple[str, ...], Parameter(name="--set", negative=())] = (),
    progress: Literal["auto", "bar", "plain", "json"] = "auto",
) -> None:
    """Trace light through one fiber and write its far-field scattering as measurements.

    Parameters
    ----------
    what
        cotton, wool, silk, polyester, nylon or viscose; or a .toml file.
    out
        The .npz or .csv file to write.
    shape
        Which of the material's cross-sections. Default: the usual one.
    overrides
        Change one value, as in --set paths=4000000. May be given several times.
    progress
        How to show the work.
    """
    from .progress import reporter
    from .simulate_fiber import simulate_fiber as simulate

    for line in simulate(what, out, shape=shape, overrides=overrides, report=reporter(progress)):
        print(line)


@app.command
def check(job: Path, *, options: JobOptions = NO_JOB_OPTIONS) -> None:
    """Say what is wrong with a job, or what it would do, without running it.

    Parameters
    ----------
    job
        The TOML file of the job.
    """
    from .check import check_job
    from .config import load

    for line in check_job(load(job, options.overrides, options.output)):
        print(line)


@app.command
def schema(output: Path | None = None) -> None:
    """Write the JSON Schema of job files, for completion and checks in an editor.

    Parameters
    ----------
    output
        The file to write. Default: standard output.
    """
    import json

    from weft.files.atomic import atomic_write

    from .config import job_schema

    text = json.dumps(job_schema(), indent=2) + "\n"
    if output is None:
        sys.stdout.write(text)
        return
    with atomic_write(output) as temporary:
        temporary.write_text(text, encoding="utf-8")


@app.command
def doctor(*, json: Annotated[bool, Parameter(negative=())] = False) -> int:
    """Say what this machine offers, what is missing, and what to install.

    Parameters
    ----------
    json
        One JSON object in place of the table.
    """
    from .doctor import examine

    return examine(as_json=json)


@app.command
def scattering(
    parameters: list[str],
    /,
    *,
    out: Path = Path("scattering.png"),
    theta_deg: float = 45.0,
) -> None:
    """Draw how fibers scatter light, print their albedo against the angle and the sampler's weight variance.

    Parameters
    ----------
    parameters
        Up to six, side by side: a preset's name, a fit (.json), a job, or a file as a preset is (.toml).
    out
        The PNG to write.
    theta_deg
        Inclination of the light from the plane across the fiber, at azimuth 0.
    """
    from .lobe_report import report_lines
    from .lobe_sources import lobes_of_all

    lobes = lobes_of_all(parameters)
    for line in report_lines(lobes):
        print(line)
    from .lobe_pictures import draw_lobes

    draw_lobes(lobes, out, theta_deg=theta_deg)
    print(f"drawn in {out}")


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
    from .inspect_file import describe

    for line in describe(file, verify=verify, as_json=json):
        print(line)


@Parameter(name="*")
@dataclass(frozen=True)
class LookOptions:
    """What a preview shows, and from where."""

    part: Literal["yarns", "fibers", "grid"] | None = None
    """What to show of a job: its yarns (default), a part of its fibers, or the grid that it made."""
    slice: Annotated[tuple[str, ...], Parameter(negative=())] = ()
    """Plane through a grid, in mm, as in --slice z=0.5. May be given several times."""
    surface: float | None = None
    """Show the grid's surface at this volume fraction."""
    box: str | None = None
    """Only what lies in x0,y0,z0,x1,y1,z1, in mm."""
    view: Literal["front", "top", "side", "iso"] | None = None
    """Where to look from. Default: the front; onto a single slice."""
    size: str | None = None
    """Pixels, as in 1280x960."""
    exposure: float = 0.0
    """Stops by which an .exr picture is brightened."""


@Parameter(name="*")
@dataclass(frozen=True)
class UnitOptions:
    """What a file of curves or triangles does not say of itself."""

    scale_to_mm: float | None = None
    """Length of one unit of the file, in mm. Needed where the file does not name its unit."""
    radius_mm: float | None = None
    """Yarn radius. Needed where the file holds none; else in place of it."""
    up_axis: Literal["y", "z"] | None = None
    """Axis that points up where the file does not say. Default: y."""
    frame: int | None = None
    """Time code to show of a .usd file with several."""


NO_LOOK_OPTIONS = LookOptions()
NO_UNIT_OPTIONS = UnitOptions()


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
    from .preview.options import preview_options
    from .preview.preview import preview as show

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


class _Terminated(Exception):
    """SIGTERM, so that what is being written is cleaned up on the way out."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command and exit: 0 done, 2 wrong input, 4 device memory, 5 disk full, 130/143 interrupted."""
    sys.exit(exit_code(sys.argv[1:] if arguments is None else arguments))


def exit_code(arguments: Sequence[str]) -> int:
    """The user's mistakes become one line on standard error; ours stay tracebacks."""
    previous = signal.signal(signal.SIGTERM, _raise_terminated)
    try:
        return _command(arguments)() or DONE
    except InputError as error:
        from .messages import shown_paths

        return _complain(shown_paths(error), error.exit_code)
    except CycloptsError as error:
        return _complain(f"weft: {error} 'weft --help' lists the commands.", WRONG_INPUT)
    except KeyboardInterrupt:
        return _complain("weft: interrupted", INTERRUPTED)
    except _Terminated:
        return _complain("weft: terminated", TERMINATED)
    except BrokenPipeError:
        sys.stderr.close()
        return DONE
    except OSError as error:
        if error.errno != errno.ENOSPC:
            raise
        return _complain(f"{error.filename or 'weft'}: no space left on the disk", NO_SPACE)
    finally:
        signal.signal(signal.SIGTERM, previous)


def _command(arguments: Sequence[str]) -> Callable[[], Any]:
    command, bound, _ = app.parse_args(list(arguments), exit_on_error=False, print_error=False)
    return lambda: command(*bound.args, **bound.kwargs)


def _raise_terminated(signal_number: int, frame: object) -> None:
    raise _Terminated


def _complain(message: str, code: int) -> int:
    print(message, file=sys.stderr)
    return code


if __name__ == "__main__":
    main()
