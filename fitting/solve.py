"""The global search: many random widths, amplitudes by variable projection, then a polish of the best few.

Optimistix' Levenberg-Marquardt does the first part; what it lacks is given to it: bounds (by a transform that
also scales the parameters, since its damping does not), float64 starts, and a convergence check of our own,
since it looks for convergence on accepted steps only. The search takes widths and T for the same at all
angles; what they become for light along the fiber is for the polish to find, where the config leaves it free.
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from weft.fiber_model.scattering.phase_jax import LobeKinds
from weft.files.errors import InputError

from .amplitudes import (
    AmplitudeChoice,
    amplitude_choice,
    full_from_amplitudes,
    lobe_columns,
    solve_amplitudes,
)
from .parameterization import SHAPE_COUNT, Parameterization, expand, widths_from_unbounded
from .projected import Polished, polish
from .residuals import DirectionData, DirectionResidual

import jax  # isort: skip  after phase_jax, which switches it to 64 bits
import jax.numpy as jnp  # isort: skip
import optimistix  # isort: skip

Array = NDArray[np.float64]

SEARCH_STEPS = 60
KEPT = 4
"""How many of the best starts are polished."""
EDM_LIMIT = 1e-6
"""About a thousandth of a standard error."""
SAME_COST = 1e-6
"""Starts whose cost per datum differs by less than this found the same minimum."""


class Solution(NamedTuple):
    """The best minimum found, and how sure it is the global one."""

    x: Array
    """All parameters, shape [P]; internal units."""
    cost: float
    """½ Σ r²."""
    edm: float
    jacobian: Array
    """Shape [residuals, P]."""
    starts: int
    starts_at_best: int
    """How many of the random starts ended, before the polish, in the best one's basin."""


def random_starts(parameterization: Parameterization, count: int, seed: int) -> Array:
    """Widths spread evenly on a logarithmic scale within their bounds; unbounded, shape [count, 5]."""
    from scipy.stats import qmc

    share = qmc.Sobol(SHAPE_COUNT, seed=np.random.default_rng(seed)).random_base2(
        max(int(np.ceil(np.log2(count))), 0)
    )[:count]
    share = 0.05 + 0.9 * share
    return np.log(share / (1 - share))


def solve(
    residual: DirectionResidual,
    parameterization: Parameterization,
    data: DirectionData,
    starts: Array,
) -> Solution:
    """The best of all starts. Raises `InputError` where none converged, with the reason."""
    choice = amplitude_choice(parameterization, residual.channels)
    kinds = residual.kinds._replace(grazing=False)
    points, costs = _search(kinds, residual.channels, parameterization, data, choice, starts)
    costs = np.where(np.isfinite(costs), costs, np.inf)
    chosen = _distinct_best(np.asarray(points), np.asarray(costs))
    end = polish_best(residual, parameterization, data, np.asarray(points)[chosen])
    near = costs <= costs.min() * (1 + 1e-3) + SAME_COST * data.values.size
    x, jacobian = np.asarray(end.x), np.asarray(end.jacobian)
    return Solution(x, float(end.cost), float(end.edm), jacobian, len(starts), int(near.sum()))


def polish_best(
    residual: DirectionResidual, parameterization: Parameterization, data: DirectionData, points: Array
) -> Polished:
    """The lowest of the minima below `points`, shape [up to KEPT, P]; refused where it is not converged."""
    points = np.concatenate([points, np.repeat(points[:1], KEPT - len(points), axis=0)])
    ends = _polish_all(residual, parameterization, data, points)
    best = int(np.argmin(np.where(np.isfinite(ends.cost), ends.cost, np.inf)))
    end: Any = jax.tree.map(lambda part: np.asarray(part[best]), ends)
    check_convergence(end, data)
    return Polished(*end)


def check_convergence(solution: Polished, data: DirectionData) -> None:
    signal = 0.5 * float(jnp.sum((data.weights * data.values) ** 2))
    if not np.isfinite(solution.cost):
        raise InputError("fit: no start gave finite residuals", hint="Look for outliers in the measurements.")
    exact = float(solution.cost) <= 1e-18 * signal
    if not (float(solution.edm) <= EDM_LIMIT or exact):
        what = (
            f"fit: not converged: after {int(solution.steps)} steps one more would still lower chi² by "
            f"{float(solution.edm):.1e} of its size per value (limit {EDM_LIMIT:g})"
        )
        raise InputError(what, hint="Raise fit.starts, tie or fix parameters, or look for outliers.")


@partial(jax.jit, static_argnames=("kinds", "channels"))
def _search(
    kinds: LobeKinds,
    channels: int,
    parameterization: Parameterization,
    data: DirectionData,
    choice: AmplitudeChoice,
    starts: jax.Array,
) -> tuple[jax.Array, jax.Array]:
    """Points [starts, P] and their costs [starts] after Levenberg-Marquardt over the widths."""

    def everything(z: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
        widths = widths_from_unbounded(parameterization, z)
        rest = jnp.asarray(parameterization.held)[SHAPE_COUNT:]
        full = expand(parameterization, jnp.concatenate([widths, rest]))
        columns = lobe_columns(kinds, channels, full, data)
        amplitudes = solve_amplitudes(columns, data, choice)
        r = data.weights * (columns @ amplitudes.T - data.values)
        return r.ravel(), full[:SHAPE_COUNT], amplitudes

    def from_start(z: jax.Array) -> tuple[jax.Array, jax.Array]:
        solver: Any = optimistix.LevenbergMarquardt(rtol=1e-4, atol=1e-5)
        found = optimistix.least_squares(
            lambda z, _: everything(z)[0], solver, z, max_steps=SEARCH_STEPS, throw=False
        ).value
        r, widths, amplitudes = everything(found)
        return full_from_amplitudes(parameterization, widths, amplitudes, channels), 0.5 * r @ r

    return jax.vmap(from_start)(starts)


@partial(jax.jit, static_argnames=("residual",))
def _polish_all(
    residual: DirectionResidual, parameterization: Parameterization, data: DirectionData, points: jax.Array
) -> Polished:
    return jax.vmap(lambda x: polish(residual, parameterization, data, x))(points)


def _distinct_best(points: Array, costs: Array) -> list[int]:
    """The `KEPT` lowest costs, leaving out points that repeat a better one."""
    chosen: list[int] = []
    for index in np.argsort(costs, kind="stable"):
        widths = np.log(points[index, :SHAPE_COUNT])
        repeats = any(np.abs(widths - np.log(points[i, :SHAPE_COUNT])).max() < 0.02 for i in chosen)
        if not repeats and np.isfinite(costs[index]):
            chosen.append(int(index))
        if len(chosen) == KEPT:
            break
    if not chosen:
        raise InputError("fit: no start gave finite residuals", hint="Look for outliers in the measurements.")
    return chosen
