"""The reciprocal longitudinal lobe of symmetric.py on JAX: differentiable with respect to its width."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from .symmetric import ROUNDS, LobeIntegral, SymmetricLobe, log_q_at, marginal_energy, rescaled, start_lobe


def symmetric_eval(
    theta_o: jax.Array, pair_theta_o: jax.Array, theta_i: jax.Array, beta: jax.Array, marginal: str
) -> jax.Array:
    """M of each pair [m]: distinct theta_o [k], the index of each pair's theta_o [m], and its theta_i [m]."""
    lobe = symmetric_lobe(marginal, beta)
    log_q_o = log_q_at(lobe, theta_o, jnp)[pair_theta_o]
    deviation = (theta_o[pair_theta_o] + theta_i) / beta
    cos_i = jnp.cos(theta_i)
    value = jnp.exp(log_q_o + log_q_at(lobe, theta_i, jnp) - 0.5 * deviation**2)
    return value * marginal_energy(marginal, cos_i, jnp) * cos_i / (beta * np.sqrt(2 * np.pi))


def symmetric_lobe(marginal: str, beta: jax.Array) -> SymmetricLobe:
    """The table of a lobe. Its derivative converges with it: each round halves the error of both."""
    integral = LobeIntegral.around_nodes(marginal, beta, jnp)

    def improve(_: int, table: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array]:
        lobe = rescaled(SymmetricLobe(*table), integral, jnp)
        return lobe.log_q, lobe.slope

    start = start_lobe(beta, jnp)
    return SymmetricLobe(*jax.lax.fori_loop(0, ROUNDS, improve, (start.log_q, start.slope)))
