"""`weft simulate-fiber`: light through one fiber by physics, written as a file of measurements."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pydantic import ValidationError

from weft.fiber_model.optics.config import FiberOpticsConfig
from weft.fiber_model.optics.materials import material_optics
from weft.files.errors import InputError

from .merging import merge
from .messages import JobErrors, Problem
from .overrides import apply_overrides
from .progress import Reporter
from .toml_source import TomlDocument, read_toml
from .validation import problems_of
from .warp_start import start_warp

if TYPE_CHECKING:
    from weft.fiber_model.optics.histogram import ScatteringHistogram
    from weft.fitting.measurements import Measurements


class FiberSimulationJob(FiberOpticsConfig):
    """What `weft simulate-fiber` reads: a material, values in its place or on top of it."""

    material: str | None = None
    """cotton, wool, silk, polyester, nylon or viscose, whose values lie under those written here."""
    shape: str | None = None
    """Which of the material's cross-sections; default the usual one."""


def simulate_fiber(
    what: str, out: Path, *, shape: str | None, overrides: Sequence[str], report: Reporter
) -> Iterator[str]:
    """Lines about what was simulated and written to `out`. Raises `InputError` for a mistake in the job.

    `what` names a material or a .toml file; `overrides` are the texts of `--set`.
    """
    from weft.fiber_model.optics.light_transport import run
    from weft.fitting.measurement_file import WRITERS, save_measurements

    if out.suffix.lower() not in WRITERS:
        hint = f"Known: {', '.join(WRITERS)}."
        raise InputError(f"measurements cannot be written to '{out.suffix}' files", path=out, hint=hint)
    job = load_simulation(what, shape=shape, overrides=overrides)
    start_warp()
    begin = time.perf_counter()
    with report.work("simulate-fiber") as progress:
        result = run(job, progress=progress)
    seconds = time.perf_counter() - begin
    save_measurements(as_measurements(result, job), out)
    yield from _albedo_lines(result)
    total = int(result.path_counts.sum())
    yield f"{total:,} paths in {seconds:.1f} s, {total / seconds / 1e6:.2f} M/s"
    if lost := int(result.lost_counts.sum()):
        yield f"warning: {lost:,} paths found no way out; their light is missing"
    yield f"wrote {out}"


def load_simulation(
    what: str, *, shape: str | None = None, overrides: Sequence[str] = ()
) -> FiberSimulationJob:
    """The job of a file or of a material alone. Raises `InputError` with a line for every mistake."""
    is_file = what.endswith(".toml")
    document = read_toml(Path(what)) if is_file else TomlDocument({"material": what}, {})
    document = apply_overrides(document, overrides)
    if shape is not None:
        document = merge(document, TomlDocument({"shape": shape}, {}))
    path = Path(what) if is_file else Path("simulate-fiber")
    document = merge(TomlDocument(_material_values(document), {}), document)
    try:
        return FiberSimulationJob.model_validate(document.table)
    except ValidationError as error:
        raise JobErrors(problems_of(error, FiberSimulationJob, document, path)) from error


def _material_values(document: TomlDocument) -> dict[str, object]:
    """What the job's material says, as the table that lies under the job."""
    material, shape = document.table.get("material"), document.table.get("shape")
    if material is None:
        if shape is not None:
            key = ("shape",)
            raise JobErrors(
                [Problem(document.origin(key), key, "goes with a material; give [cross_section]")]
            )
        return {}
    try:
        optics = material_optics(str(material), None if shape is None else str(shape))
    except InputError as error:
        raise InputError(_placed(document, error), hint=error.hint) from error
    return optics.model_dump(include=optics.model_fields_set)


def _placed(document: TomlDocument, error: InputError) -> str:
    origin = document.origin(("material",))
    return Problem(origin, (), error.what).line() if origin else error.what


def as_measurements(result: ScatteringHistogram, job: FiberSimulationJob) -> Measurements:
    """One row for each inclination and bin: f_p averaged over the bin, at its middle.

    sigma is the standard error with the light of one path added in square, so that a bin which a few paths
    or none happened to reach does not pass for a sure one.
    """
    from weft.fitting.measurements import Measurements

    rows = np.broadcast_shapes((len(result.theta_i), 1, 1), (1, *result.bins.shape))
    theta_i, theta_o, phi_o = (
        np.ascontiguousarray(np.broadcast_to(angle, rows)).ravel()
        for angle in (result.theta_i[:, None, None], result.bins.theta[:, None], result.bins.phi)
    )
    sigma = np.hypot(result.standard_errors(), result.resolution())
    return Measurements(
        theta_i=theta_i,
        phi_i=np.zeros_like(theta_i),
        theta_o=theta_o,
        phi_o=phi_o,
        values=result.phase_function().reshape(-1, 3),
        quantity="phase_function",
        sigma=sigma.reshape(-1, 3),
        channels=("r", "g", "b"),
        source=_source(job),
    )


def _source(job: FiberSimulationJob) -> str:
    shape = ", ".join(f"{k} {v}" for k, v in job.cross_section.model_dump(exclude={"vertices_mm"}).items())
    fiber = (
        f"index {job.refractive_index:g}, roughness {job.roughness:g}, absorption {job.absorption_per_mm}/mm"
    )
    bins = f"means over bins of {job.theta_bin_deg:g} x {job.phi_bin_deg:g} degrees"
    name = f"{job.material}: " if job.material else ""
    paths = f"{job.paths:,} paths for each inclination, seed {job.seed}"
    return f"light transport through one fiber; {name}{shape}; {fiber}; {paths}; {bins}"


def _albedo_lines(result: ScatteringHistogram) -> Iterator[str]:
    mean, error = result.albedo()
    energies = result.energies()[:, :, 1]
    for k, theta in enumerate(result.theta_i):
        colors = " ".join(f"{value:.4f}" for value in mean[k])
        orders = " ".join(f"{value:.3f}" for value in energies[k])
        light = f"light at {math.degrees(theta):4.0f} deg"
        yield f"{light}: albedo {colors} ± {error[k].max():.4f}; R TT TRT rest (green) {orders}"
