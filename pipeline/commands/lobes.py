"""Light and one fiber: `weft simulate-fiber` and `weft scattering`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from .app import app
from .options import ShowProgress


@app.command(name="simulate-fiber")
def simulate_fiber(
    what: str,
    /,
    *,
    out: Path,
    shape: str | None = None,
    overrides: Annotated[tuple[str, ...], Parameter(name="--set", negative=())] = (),
    progress: ShowProgress = "auto",
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
    from weft.pipeline.progress import reporter
    from weft.pipeline.simulate_fiber import simulate_fiber as simulate

    for line in simulate(what, out, shape=shape, overrides=overrides, report=reporter(progress)):
        print(line)


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
    from weft.pipeline.lobe_report import report_lines
    from weft.pipeline.lobe_sources import lobes_of_all

    lobes = lobes_of_all(parameters)
    for line in report_lines(lobes):
        print(line)
    from weft.pipeline.lobe_pictures import draw_lobes

    draw_lobes(lobes, out, theta_deg=theta_deg)
    print(f"drawn in {out}")
