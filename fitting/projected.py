"""Levenberg-Marquardt within bounds: steps are projected, and parameters held at a bound leave the step.

Marquardt's scaling by the diagonal of JᵀJ, so units do not matter. Runs under vmap. It finishes what the
search with transformed bounds begins: a transform has no slope at its bounds and never arrives there.
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

from .parameterization import AZIMUTHAL, Parameterization, expand
from .residuals import Residual

import jax  # isort: skip  after phase_jax, which switches it to 64 bits
import jax.numpy as jnp  # isort: skip

MAX_STEPS = 1000
EDM_GOAL = 1e-9
"""Expected decrease of the cost by a full Newton step, relative to cost per degree of freedom, to stop at."""
_NEVER_LARGER = 1e12


class Polished(NamedTuple):
    """A local minimum. All parameters are given, fixed and tied ones too."""

    x: jax.Array
    """Shape [P], internal units; entries that are not free repeat the expanded ones."""
    cost: jax.Array
    """½ Σ r²."""
    edm: jax.Array
    """Estimated distance to the minimum: what a full step would still gain, in units of r² per datum."""
    steps: jax.Array
    jacobian: jax.Array
    """dr / dx, shape [residuals, P]; zero columns where x is not free."""


class _State(NamedTuple):
    x: jax.Array
    r: jax.Array
    jacobian: jax.Array
    damping: jax.Array
    edm: jax.Array
    step: jax.Array


@partial(jax.jit, static_argnames=("residual", "max_steps"))
def polish(
    residual: Residual, p: Parameterization, data: Any, x: jax.Array, max_steps: int = MAX_STEPS
) -> Polished:
    """From `x`, shape [P], to the local minimum within the bounds."""
    function = partial(_residuals_of_free, residual, p, data)

    def advance(state: _State) -> _State:
        return _step(function, p, state)

    def unfinished(state: _State) -> jax.Array:
        stuck = state.damping > _NEVER_LARGER
        return (state.step < max_steps) & (state.edm > EDM_GOAL) & ~stuck

    x = jnp.clip(jnp.where(jnp.asarray(p.free) > 0, x, p.held), p.lower, p.upper)
    start = _State(
        x, function(x), jax.jacfwd(function)(x), jnp.asarray(1e-3), jnp.asarray(jnp.inf), jnp.asarray(0)
    )
    start = start._replace(edm=_edm(p, start))
    end = jax.lax.while_loop(unfinished, advance, start)
    return Polished(expand(p, end.x), 0.5 * end.r @ end.r, end.edm, end.step, end.jacobian)


@partial(jax.jit, static_argnames=("residual",))
def free_jacobian(residual: Residual, p: Parameterization, data: Any, x: jax.Array) -> jax.Array:
    """dr / dx, shape [residuals, P]; zero columns where x is not free."""
    return jax.jacfwd(partial(_residuals_of_free, residual, p, data))(x)


def _residuals_of_free(residual: Residual, p: Parameterization, data: Any, x: jax.Array) -> jax.Array:
    return residual(expand(p, x), data)


def _step(function: Any, p: Parameterization, state: _State) -> _State:
    """Try one damped step; keep it where the cost falls."""
    gradient = state.jacobian.T @ state.r
    normal = state.jacobian.T @ state.jacobian
    moving = _moving(p, state.x, gradient)
    delta = _newton(normal, gradient, moving, state.damping)
    x = jnp.clip(_moved(state.x, delta), p.lower, p.upper)
    r = function(x)
    gain = 0.5 * (state.r @ state.r - r @ r)
    better = jnp.isfinite(gain) & (gain > 0)
    accepted = _State(
        x, r, jax.jacfwd(function)(x), jnp.maximum(state.damping / 9, 1e-15), state.edm, state.step + 1
    )
    rejected = state._replace(damping=state.damping * 7, step=state.step + 1)
    merged = jax.tree.map(lambda new, old: jnp.where(better, new, old), accepted, rejected)
    return merged._replace(edm=_edm(p, merged))


def _moved(x: jax.Array, delta: jax.Array) -> jax.Array:
    """x + delta; azimuthal widths move along their mean resultant length exp(-gamma²/2) instead.

    A wide lobe is 1 + 2 exp(-gamma²/2) cos(phi): nearly linear in that length, and flat in gamma.
    """
    gamma = x[AZIMUTHAL]
    length = jnp.exp(-0.5 * gamma**2)
    new = jnp.clip(length * (1 - gamma * delta[AZIMUTHAL]), 1e-9, 1 - 1e-9)
    return (x + delta).at[AZIMUTHAL].set(jnp.sqrt(-2 * jnp.log(new)))


def _moving(p: Parameterization, x: jax.Array, gradient: jax.Array) -> jax.Array:
    """1.0 for the free parameters that are not pressed against a bound."""
    at_lower = (x <= p.lower) & (gradient > 0)
    at_upper = (x >= p.upper) & (gradient < 0)
    return jnp.where(at_lower | at_upper, 0.0, jnp.asarray(p.free))


def _newton(normal: jax.Array, gradient: jax.Array, moving: jax.Array, damping: jax.Array) -> jax.Array:
    """-(N + damping diag N)⁻¹ g over the moving parameters, in coordinates scaled by the diagonal."""
    size = jnp.sqrt(jnp.diagonal(normal))
    size = jnp.where(size > 1e-12 * size.max(), size, 1.0)
    scaled = normal / (size[:, None] * size) * (moving[:, None] * moving)
    solved = jnp.linalg.solve(scaled + jnp.diag(1 - moving + damping), -gradient / size * moving)
    return solved / size * moving


def _edm(p: Parameterization, state: _State) -> jax.Array:
    """½ gᵀ N⁻¹ g over the moving parameters, over r² per datum. Directions of no effect drop out."""
    gradient = state.jacobian.T @ state.r
    normal = state.jacobian.T @ state.jacobian
    delta = _newton(normal, gradient, _moving(p, state.x, gradient), jnp.asarray(1e-9))
    per_datum = jnp.maximum(state.r @ state.r / state.r.size, 1e-20)
    return -0.5 * gradient @ delta / per_datum
