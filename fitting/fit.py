"""The stage: measurements in, scattering parameters with their errors out."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from weft.fiber_model.scattering.parameters import FiberScatteringParameters

from . import noise as noises
from .compilation_cache import keep_compiled_functions
from .config import GRAZING, FitConfig
from .identifiability import find_degeneracies
from .intervals import Intervals, intervals_of
from .measurements import Measurements
from .parameterization import (
    FRESNEL_TT,
    SCALE,
    SHAPE_COUNT,
    color_slice,
    grazing_slice,
    parameter_names,
    to_external_units,
)
from .problem import FitProblem
from .residuals import direction_data, predict
from .result import FitResult, FittedParameter, HeldOutError
from .selection import load_all, split
from .solve import Solution
from .uncertainty import Uncertainty

import jax.numpy as jnp  # isort: skip  after phase_jax, which switches it to 64 bits

Array = NDArray[np.float64]
Progress = Callable[[float, str], None]

NEAR_BOUND_ERRORS = 3.0


def run(
    config: FitConfig, measurements: Measurements | None = None, *, progress: Progress | None = None
) -> FitResult:
    """Fit the config's files, or `measurements` in their place.

    Raises `InputError`, with the reason, where the fit does not converge or the data do not suit.
    """
    report = progress or (lambda fraction, detail: None)
    keep_compiled_functions()
    hashes = () if measurements is not None else tuple((p.name, _sha256(p)) for p in config.measurements)
    seen, unseen = split(measurements or load_all(config.measurements), config)
    problem = FitProblem(config, seen)
    report(0.05, f"searching from {config.starts} starts")
    solution = problem.solve()
    report(0.6, "errors")
    jacobian = problem.jacobian(solution)
    uncertainty = problem.uncertainty(solution, jacobian)
    report(0.7, f"intervals: {config.intervals}")
    intervals = intervals_of(problem, solution, uncertainty)
    return _result(problem, solution, jacobian, uncertainty, intervals, unseen, hashes)


def _result(
    problem: FitProblem,
    solution: Solution,
    jacobian: Array,
    uncertainty: Uncertainty,
    intervals: Intervals,
    unseen: Measurements | None,
    hashes: tuple[tuple[str, str], ...],
) -> FitResult:
    seen, count = problem.seen, len(problem.seen)
    unit = to_external_units(np.ones(len(solution.x)))
    covariance = uncertainty.covariance * np.outer(unit, unit)
    unseen_model = None if unseen is None else _predict_others(problem, solution.x, unseen)
    return FitResult(
        config=problem.config,
        parameters=scattering_parameters(solution.x, problem),
        scale=float(solution.x[SCALE]),
        fitted=tuple(_fitted(problem, solution.x, uncertainty, intervals)),
        covariance=covariance,
        correlations=_correlations(covariance),
        degeneracies=tuple(
            find_degeneracies(
                solution.x,
                jacobian,
                uncertainty,
                parameter_names(problem.channels, grazing=problem.config.grazing),
                free=problem.parameterization.free > 0,
                lights=seen.theta_i,
                azimuths=seen.phi_o - seen.phi_i,
            )
        ),
        chi2=float((problem.residuals(solution.x) ** 2).sum()),
        degrees_of_freedom=uncertainty.degrees_of_freedom,
        variance_scale=uncertainty.variance_scale,
        condition=uncertainty.condition,
        edm=solution.edm,
        starts=solution.starts,
        starts_at_best=solution.starts_at_best,
        held_out=tuple(_held_out(problem, unseen, unseen_model)),
        seen=seen,
        model=problem.predicted(solution.x)[:count],
        unseen=unseen,
        unseen_model=unseen_model,
        data_sha256=hashes,
    )


def scattering_parameters(x: Array, problem: FitProblem) -> FiberScatteringParameters:
    def color(name: str) -> tuple[float, float, float]:
        values = [float(value) for value in x[color_slice(name, problem.channels)]]
        return (values[0], values[0], values[0]) if len(values) == 1 else (values[0], values[1], values[2])

    r, tt, trt, around_tt, around_trt = (float(width) for width in x[:SHAPE_COUNT])
    config = problem.config
    parameters = FiberScatteringParameters(
        longitudinal_width_r=r,
        longitudinal_width_tt=tt,
        longitudinal_width_trt=trt,
        azimuthal_width_tt=around_tt,
        azimuthal_width_trt=around_trt if config.gamma_trt else None,
        fresnel_tt=float(x[FRESNEL_TT]),
        longitudinal=config.longitudinal,
        azimuthal=config.azimuthal,
        fresnel_r=color("fresnel_r"),
        color_r=color("color_r"),
        color_tt=color("color_tt"),
        color_trt=color("color_trt"),
    )
    return replace(parameters, **(_along_fiber(x, config) | config.held_shapes))


def _along_fiber(x: Array, config: FitConfig) -> dict[str, Any]:
    """Widths and T for light along the fiber, where they are of their own."""
    values = dict(zip(GRAZING, map(float, x[grazing_slice(len(x))]), strict=False))
    if not config.gamma_trt:
        values.pop("azimuthal_width_trt_grazing_deg", None)
    return {name.removesuffix("_deg"): value for name, value in values.items()}


def _fitted(
    problem: FitProblem,
    x: Array,
    uncertainty: Uncertainty,
    intervals: Intervals,
) -> list[FittedParameter]:
    p = problem.parameterization
    errors = uncertainty.standard_errors
    near = np.minimum(x - p.lower, p.upper - x) < NEAR_BOUND_ERRORS * errors
    tied = p.tie_source != np.arange(len(x))
    unit = to_external_units(np.ones(len(x)))
    result = []
    for i, name in enumerate(parameter_names(problem.channels, grazing=problem.config.grazing)):
        role = "free" if p.free[i] else "tied" if tied[i] else "fixed"
        bound = "lower" if uncertainty.at_lower[i] else "upper" if uncertainty.at_upper[i] else None
        error = float(errors[i] * unit[i]) if np.isfinite(errors[i]) else None
        value = float(x[i] * unit[i])
        warn = role != "fixed" and bound is None and error is not None and bool(near[i])
        result.append(FittedParameter(name, value, role, error, bound, warn, intervals[i]))
    return result


def _correlations(covariance: Array) -> Array:
    deviation = np.sqrt(np.diag(covariance))
    product = np.outer(deviation, deviation)
    return np.divide(covariance, product, out=np.zeros_like(covariance), where=product > 0)


def _predict_others(problem: FitProblem, x: Array, others: Measurements) -> Array:
    data = direction_data(others, problem.config.held_shapes)
    values = predict(problem.residual.kinds, problem.channels, jnp.asarray(x), data)
    return np.asarray(values)[: len(others)]


def _held_out(problem: FitProblem, unseen: Measurements | None, model: Array | None) -> list[HeldOutError]:
    if unseen is None or model is None:
        return []
    sigma = noises.standard_deviations(problem.noise, unseen, np.asarray(problem.data.peak), model)
    result = []
    for light in np.unique(np.round(np.degrees(unseen.theta_i), 6)):
        at = np.abs(np.degrees(unseen.theta_i) - light) < 1e-5
        gap, values = (model - unseen.values)[at], unseen.values[at]
        relative = float(np.sqrt((gap**2).sum() / max((values**2).sum(), 1e-300)))
        chi2 = float("nan") if sigma is None else float(((gap / sigma[at]) ** 2).mean())
        result.append(HeldOutError(float(light), int(values.size), relative, chi2))
    return result


def _sha256(path: Path) -> str:
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
