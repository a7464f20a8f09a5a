"""Intervals of the parameters: from the covariance, by profile likelihood, or by a parametric bootstrap."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .parameterization import Parameterization, to_external_units
from .problem import FitProblem
from .projected import polish
from .residuals import DirectionData, DirectionResidual, transform_slope
from .result import LEVELS
from .solve import Solution
from .uncertainty import Uncertainty, quantile

import jax  # isort: skip  after phase_jax, which switches it to 64 bits
import jax.numpy as jnp  # isort: skip

Array = NDArray[np.float64]
Intervals = list[tuple[tuple[float, float], ...] | None]

PROFILE_REACH = np.array([-4.0, -3.0, -2.2, -1.6, -1.1, -0.7, -0.35, 0.35, 0.7, 1.1, 1.6, 2.2, 3.0, 4.0])
"""Where a profile is computed, in standard errors from the minimum."""
AT_ONCE = 32
"""Refits of one batch; bounds the memory."""


def intervals_of(problem: FitProblem, solution: Solution, uncertainty: Uncertainty) -> Intervals:
    """At `LEVELS`, in external units (degrees); None for what is fixed, at a bound, or undetermined."""
    standard = _standard(problem, solution, uncertainty)
    kind = problem.config.intervals
    if kind == "standard":
        bounds = standard
    elif kind == "profile":
        bounds = _profile(problem, solution, uncertainty, standard)
    else:
        bounds = _bootstrap(problem, solution, uncertainty)
    errors = uncertainty.standard_errors
    has_one = np.isfinite(errors) & (errors > 0)
    external = to_external_units(bounds)
    return [
        tuple((float(low), float(high)) for low, high in external[:, :, i]) if has_one[i] else None
        for i in range(len(errors))
    ]


def _standard(problem: FitProblem, solution: Solution, uncertainty: Uncertainty) -> Array:
    """Value ± quantile * standard error within the bounds, shape [levels, 2, P]."""
    p = problem.parameterization
    errors = np.where(np.isfinite(uncertainty.standard_errors), uncertainty.standard_errors, 0.0)
    reach = np.array([quantile(level, uncertainty) for level in LEVELS])
    sides = np.array([-1.0, 1.0])
    return np.clip(solution.x + reach[:, None, None] * sides[:, None] * errors, p.lower, p.upper)


def _profile(problem: FitProblem, solution: Solution, uncertainty: Uncertainty, standard: Array) -> Array:
    """Where chi² with one parameter held, the others refitted, has risen by quantile²; as `_standard`.

    Tied parameters follow their source. A profile that meets a bound first ends there.
    """
    p, bounds = problem.parameterization, standard.copy()
    errors = uncertainty.standard_errors
    chosen = np.flatnonzero((p.free > 0) & np.isfinite(errors) & (errors > 0))
    values = np.clip(
        solution.x[chosen, None] + PROFILE_REACH * errors[chosen, None],
        p.lower[chosen, None],
        p.upper[chosen, None],
    )
    entries = np.repeat(chosen, len(PROFILE_REACH))
    costs = np.asarray(
        _costs_with_one_held(problem.residual, p, problem.data, solution.x, entries, values.ravel())
    )
    rise = 2 * (costs.reshape(values.shape) - solution.cost) / uncertainty.variance_scale
    for row, entry in enumerate(chosen):
        for level, name in enumerate(LEVELS):
            bounds[level, :, entry] = _crossings(
                values[row], rise[row], float(solution.x[entry]), quantile(name, uncertainty)
            )
    return _with_tied(p, bounds)


def _crossings(values: Array, rise: Array, best: float, reach: float) -> tuple[float, float]:
    """Where sqrt(rise), signed, passes -reach and +reach: nearly a straight line, so interpolate it."""
    signed = np.sign(values - best) * np.sqrt(np.maximum(rise, 0.0))
    order = np.argsort(np.append(values, best), kind="stable")
    signed, values = np.append(signed, 0.0)[order], np.append(values, best)[order]
    rising = np.maximum.accumulate(signed)
    return float(np.interp(-reach, rising, values)), float(np.interp(reach, rising, values))


def _with_tied(p: Parameterization, bounds: Array) -> Array:
    """Bounds of tied parameters from those of their source: a power of a positive number is monotone."""
    tied = np.flatnonzero(p.tie_source != np.arange(len(p.free)))
    source = bounds[:, :, p.tie_source[tied]]
    bounds[:, :, tied] = p.tie_factor[tied] * source ** p.tie_power[tied]
    return bounds


@partial(jax.jit, static_argnames=("residual",))
def _costs_with_one_held(
    residual: DirectionResidual,
    p: Parameterization,
    data: DirectionData,
    x: jax.Array,
    entries: jax.Array,
    values: jax.Array,
) -> jax.Array:
    """½ chi² with parameter `entries[i]` held at `values[i]` and the others refitted, shape [i]."""

    def one(job: tuple[jax.Array, jax.Array]) -> jax.Array:
        entry, value = job
        free: Any = jnp.asarray(p.free).at[entry].set(0.0)
        held: Any = jnp.asarray(p.held).at[entry].set(value)
        return polish(residual, p._replace(free=free, held=held), data, x).cost

    return jax.lax.map(one, (entries, values), batch_size=AT_ONCE)


def _bootstrap(problem: FitProblem, solution: Solution, uncertainty: Uncertainty) -> Array:
    """Percentiles of refits to the model's values with new noise. Shape as `_standard`."""
    refits = bootstrap_refits(problem, solution, uncertainty, problem.config.bootstrap_samples)
    tails = np.array([[0.5 * (1 - level), 0.5 * (1 + level)] for level in LEVELS])
    return np.stack([np.quantile(refits, tail, axis=0) for tail in tails])


def bootstrap_refits(problem: FitProblem, solution: Solution, uncertainty: Uncertainty, count: int) -> Array:
    """Parameters refitted to `count` sets of synthetic values, shape [count, P]."""
    weights = np.asarray(problem.data.weights)
    model = problem.predicted(solution.x)
    slope = transform_slope(problem.config.loss, model, np.asarray(problem.data.peak))
    sigma = np.divide(
        np.sqrt(uncertainty.variance_scale), weights * slope, out=np.zeros_like(weights), where=weights > 0
    )
    noise = np.random.default_rng(problem.config.seed).normal(size=(count, *model.shape))
    return np.asarray(
        _refit(problem.residual, problem.parameterization, problem.data, solution.x, model + sigma * noise)
    )


@partial(jax.jit, static_argnames=("residual",))
def _refit(
    residual: DirectionResidual, p: Parameterization, data: DirectionData, x: jax.Array, values: jax.Array
) -> jax.Array:
    def one(drawn: jax.Array) -> jax.Array:
        return polish(residual, p, data._replace(values=drawn), x).x

    return jax.lax.map(one, values, batch_size=AT_ONCE)
