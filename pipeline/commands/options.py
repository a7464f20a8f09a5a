"""Options that several commands share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

ShowProgress = Literal["auto", "bar", "plain", "json"]


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
    resume: Annotated[bool, Parameter(negative=())] = False
    """Go on from the picture's checkpoint, where there is one; its bits are those of a run never stopped."""
    progress: ShowProgress = "auto"
    """Bars on a terminal and plain lines elsewhere, or one JSON object a line on standard output."""


@Parameter(name="*")
@dataclass(frozen=True)
class FrameOptions:
    """Which frame of a sequence."""

    frame: int | None = None
    """Frame of a sequence: the number in names such as cloth.####.obj, or the time code of a .usd file."""


NO_FRAME_OPTIONS = FrameOptions()
NO_JOB_OPTIONS = JobOptions()
NO_RUN_OPTIONS = RunOptions()


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
