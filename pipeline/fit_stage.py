"""The stage `fit`: measured scattering to a file of parameters, with its report; and its place before others.

`[scattering] fit` is read when the job is, so a fit that makes that file runs before the rest of the job is
looked at.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from weft.files.input_file import TextFromFile

from .config import load
from .job import Job, read_job
from .merging import sub_table
from .progress import Reporter
from .run import run_chain
from .stage import Stage, StageWork

FIT_TABLES = ("fit", "output")
"""All that a fit looks at."""


def make_fit(work: StageWork) -> dict[str, Any]:
    from weft.fiber_model.scattering.parameter_file import save_parameters
    from weft.files.atomic import atomic_write
    from weft.fitting.fit import run
    from weft.fitting.plots import write_plots
    from weft.fitting.report import markdown, parameter_file

    result = run(work.job.table("fit"), progress=work.progress)
    outputs = work.outputs
    write_plots(result, outputs["slices"], outputs["residuals"])
    plots = {"Slices": outputs["slices"].name, "Residuals": outputs["residuals"].name}
    with atomic_write(outputs["report"]) as temporary:
        temporary.write_text(markdown(result, plots), encoding="utf-8")
    save_parameters(outputs["fit"], parameter_file(result))
    ratio = result.chi2 / result.degrees_of_freedom
    names = "; ".join(degeneracy.name for degeneracy in result.degeneracies)
    return {
        "summary": f"{result.seen.values.size:,} values, chi² {ratio:.3g} per degree of freedom, "
        f"{result.starts_at_best} of {result.starts} starts agree"
        + (f"; undetermined: {names}" if names else ""),
        "chi2": result.chi2,
        "degrees_of_freedom": result.degrees_of_freedom,
        "degeneracies": [degeneracy.name for degeneracy in result.degeneracies],
    }


def fit_files(job: Job) -> dict[str, str]:
    result = job.table("fit").result
    stem = Path(result).stem
    return {
        "fit": result,
        "report": f"{stem}.md",
        "slices": f"{stem}_slices.png",
        "residuals": f"{stem}_residuals.png",
    }


FIT = Stage(
    name="fit",
    tables=("fit",),
    inputs={},
    outputs=fit_files,
    work=make_fit,
    code=("fitting", "fiber_model/scattering"),
    libraries=("numpy", "scipy", "jax", "jaxlib", "optimistix"),
)


def run_fit_first(
    path: Path, overrides: Sequence[str], output: Path | None, *, report: Reporter, force: bool
) -> bool:
    """Run the job's fit where its [scattering] takes the result; whether it did."""
    job = load(path, overrides, output, only=FIT_TABLES)
    if not job.has("fit") or not _scattering_takes(job.output / job.table("fit").result, path, overrides):
        return False
    run_chain(job, {"fit": FIT}, ["fit"], report=report, force=force)
    return True


def fit_to_come(path: Path, overrides: Sequence[str], output: Path | None) -> Path | None:
    """The result of the job's fit, where its [scattering] takes it and it is not made yet."""
    job = load(path, overrides, output, only=FIT_TABLES)
    if not job.has("fit"):
        return None
    result: Path = job.output / job.table("fit").result
    return result if not result.is_file() and _scattering_takes(result, path, overrides) else None


def _scattering_takes(result: Path, path: Path, overrides: Sequence[str]) -> bool:
    """Whether a `fit = "…"` in [scattering] or a type of it names this file."""
    part = sub_table(read_job(path, overrides), ("scattering",))
    return part is not None and os.path.realpath(result) in map(os.path.realpath, _fits_named(part.table))


def _fits_named(table: dict[str, Any]) -> Iterator[Path]:
    for key, value in table.items():
        if key == "fit" and isinstance(value, TextFromFile):
            yield Path(value.folder, value)
        elif isinstance(value, dict):
            yield from _fits_named(value)
