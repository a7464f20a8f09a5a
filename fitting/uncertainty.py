"""How well the data determine the parameters: covariance from the Jacobian at the minimum, by its SVD.

Directions that the data do not see are left out and reported; parameters at a bound count as fixed there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .parameterization import Parameterization, expand
from .residuals import DirectionResidual

import jax  # isort: skip  after phase_jax, which switches it to 64 bits
import jax.numpy as jnp  # isort: skip

Array = NDArray[np.float64]

NULL_SINGULAR_VALUE = 1e-6
"""Of the Jacobian with columns of length one, relative to the largest: below it is a direction unseen."""
INVOLVED = 1e-2
"""A parameter with at least this share in an unseen direction is undetermined."""
AT_BOUND = 1e-9


@dataclass(frozen=True)
class Uncertainty:
    """Of all parameters, in internal units (radians)."""

    covariance: Array
    """Shape [P, P]; zero for what is fixed or at a bound."""
    undetermined: NDArray[np.bool_]
    """Shape [P]: the data do not determine it."""
    at_lower: NDArray[np.bool_]
    at_upper: NDArray[np.bool_]
    condition: float
    """Of the Jacobian of the free parameters with columns of length one."""
    variance_scale: float
    """What the covariance was multiplied by: 1 where sigma is taken at its word."""
    degrees_of_freedom: int

    @property
    def standard_errors(self) -> Array:
        return np.where(self.undetermined, np.inf, np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))


def estimate(
    residual: DirectionResidual,
    parameterization: Parameterization,
    x: Array,
    jacobian: Array,
    r: Array,
    *,
    absolute: bool,
) -> Uncertainty:
    """From the Jacobian [n, P] and the residuals [n] before the robust transform; padding rows are zero."""
    p = parameterization
    span = p.upper - p.lower
    free = p.free > 0
    at_lower = free & (x - p.lower <= AT_BOUND * span)
    at_upper = free & (p.upper - x <= AT_BOUND * span)
    moving = np.flatnonzero(free & ~at_lower & ~at_upper)
    used = int((r != 0).sum())
    freedom = max(used - len(moving), 1)
    size, v, _, condition = _directions(jacobian[:, moving])
    # a fit that slid along an unseen direction to a bound must not hide it: look among all free ones
    null = _directions(jacobian[:, free])[2]
    scale = 1.0 if absolute else float(jnp.sum(residual.hold_back(jnp.asarray(r)) ** 2)) / freedom
    inner = _inner_covariance(residual, (jacobian[:, moving] / size) @ v, r, scale)
    covariance = np.zeros((len(x), len(x)))
    covariance[np.ix_(moving, moving)] = (v @ inner @ v.T) / np.outer(size, size)
    unseen = np.zeros(len(x), dtype=bool)
    unseen[free] = (null**2).sum(axis=0) > INVOLVED**2
    spread = np.asarray(jax.jacfwd(lambda free_x: expand(p, free_x))(jnp.asarray(x)))
    return Uncertainty(
        covariance=spread @ covariance @ spread.T,
        undetermined=(np.abs(spread) @ unseen) > 0,
        at_lower=at_lower,
        at_upper=at_upper,
        condition=condition,
        variance_scale=scale,
        degrees_of_freedom=freedom,
    )


def _directions(columns: Array) -> tuple[Array, Array, Array, float]:
    """Column lengths; seen directions [moving, seen]; unseen ones [unseen, moving]; condition number."""
    size = np.linalg.norm(columns, axis=0)
    size = np.where(size > 1e-12 * size.max(initial=1e-300), size, 1e300)
    _, singular, vt = np.linalg.svd(columns / size, full_matrices=False)
    seen = singular > NULL_SINGULAR_VALUE * singular.max(initial=0.0)
    smallest = singular.min(initial=np.inf)
    condition = float(singular.max(initial=0.0) / smallest) if smallest > 0 else np.inf
    return np.asarray(size, dtype=np.float64), vt[seen].T, vt[~seen], condition


def _inner_covariance(residual: DirectionResidual, columns: Array, r: Array, scale: float) -> Array:
    """Of the seen directions: (JᵀJ)⁻¹ s², or the sandwich A⁻¹BA⁻¹ of a robust loss (Huber 1981)."""
    if residual.robust == "none":
        return np.asarray(np.linalg.inv(columns.T @ columns) * scale)
    influence, slope = _influence(residual, r)
    bread = np.linalg.inv(columns.T @ (slope[:, None] * columns))
    filling = columns.T @ (influence[:, None] ** 2 * columns)
    return np.asarray(bread @ filling @ bread)


def _influence(residual: DirectionResidual, r: Array) -> tuple[Array, Array]:
    """psi = rho'/2 and its slope, of each residual before the robust transform."""
    ratio = r / residual.robust_sigmas
    if residual.robust == "huber":
        inside = np.abs(ratio) <= 1
        return np.where(inside, r, residual.robust_sigmas * np.sign(r)), inside.astype(float)
    return r / (1 + ratio**2), (1 - ratio**2) / (1 + ratio**2) ** 2


def quantile(level: float, uncertainty: Uncertainty) -> float:
    """Half width of a central interval, in standard errors: normal, or Student's t where sigma was scaled."""
    from scipy import stats

    upper = 0.5 * (1 + level)
    if uncertainty.variance_scale == 1.0:
        return float(stats.norm.ppf(upper))
    return float(stats.t.ppf(upper, uncertainty.degrees_of_freedom))
