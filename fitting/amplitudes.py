"""Variable projection (Golub and Pereyra 1973): given the widths, the amplitudes follow linearly.

With s = (1 - cos theta)^5 the model is a0 (1-s) L_R + a1 s L_R + b (1-s) L_TT + d (1-s) L_TRT per channel.
With the scale k: a1 = k C_R, a0 = a1 F_R, b = k C_TT T (1-F_R), d = k C_TRT (1-T) (1-F_R). Only widths are
left to search for, and no start can be bad in the amplitudes.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np

from weft.fiber_model.scattering.phase_jax import LobeKinds, lobe_densities, schlick

from .parameterization import (
    FRESNEL_TT,
    SCALE,
    Parameterization,
    color_slice,
    expand,
    grazing_slice,
    lobe_parameters,
)
from .residuals import DirectionData

import jax  # isort: skip  after phase_jax, which switches it to 64 bits
import jax.numpy as jnp  # isort: skip

A0, A1, B, D = range(4)
_SUBSETS = np.array(list(itertools.product((0.0, 1.0), repeat=4)))
_RIDGE = 1e-9


class AmplitudeChoice(NamedTuple):
    """Which amplitudes are free, shape [4] (1.0 or 0.0), and the value of a1 where it is not."""

    free: np.ndarray
    held_a1: float


def amplitude_choice(parameterization: Parameterization, channels: int) -> AmplitudeChoice:
    """a1 is known where C_R and the scale are; TRT is absent where all light leaves at once."""
    held = parameterization
    red = color_slice("color_r", channels)
    known = not held.free[red].any() and not held.free[SCALE] and len(set(held.held[red])) == 1
    no_trt = held.free[FRESNEL_TT] == 0 and held.held[FRESNEL_TT] == 1.0
    free = np.array([1.0, 0.0 if known else 1.0, 1.0, 0.0 if no_trt else 1.0])
    return AmplitudeChoice(free, float(held.held[red.start] * held.held[SCALE]) if known else 0.0)


def lobe_columns(kinds: LobeKinds, channels: int, full: jax.Array, data: DirectionData) -> jax.Array:
    """The four functions that the amplitudes multiply, shape [N, 4]."""
    lobes = lobe_parameters(full, channels)._replace(**data.held_shapes)
    along_around = lobe_densities(kinds, lobes, data.directions)
    s = schlick(jnp.cos(data.directions.theta_o))[data.directions.pair_theta_o[data.directions.pair]]
    columns = [data.factor * lobe for lobe in along_around.T]
    r, tt, trt, grazing = (
        columns if len(columns) == 4 else (*columns, columns[0])
    )  # as phase.py of `symmetric`
    return jnp.stack([r - s * grazing, s * grazing, (1 - s) * tt, (1 - s) * trt], axis=-1)


def solve_amplitudes(columns: jax.Array, data: DirectionData, choice: AmplitudeChoice) -> jax.Array:
    """Non-negative amplitudes of least squares, shape [C, 4]; differentiable in the columns."""
    squared = data.weights**2
    target = data.values - choice.held_a1 * columns[:, A1, None]
    normal = jnp.einsum("nc,ni,nj->cij", squared, columns, columns)
    right = jnp.einsum("nc,nc,ni->ci", squared, target, columns)
    solved = jax.vmap(_non_negative, in_axes=(0, 0, None))(normal, right, choice.free)
    return solved.at[:, A1].add(choice.held_a1)


def _non_negative(normal: jax.Array, right: jax.Array, free: jax.Array | np.ndarray) -> jax.Array:
    """argmin ½ aᵀNa - rᵀa over a >= 0, by trying every set of positive entries."""
    size = jnp.sqrt(jnp.diagonal(normal)) + 1e-300
    normal, right = normal / (size[:, None] * size), right / size

    def solution(subset: jax.Array) -> jax.Array:
        masked = normal * (subset[:, None] * subset) + jnp.diag(1 - subset + _RIDGE)
        return jnp.linalg.solve(masked, right * subset)

    def cost(subset: jax.Array) -> jax.Array:
        a = solution(subset)
        return jnp.where((a < -1e-12).any(), jnp.inf, 0.5 * a @ normal @ a - right @ a)

    subsets = jnp.asarray(_SUBSETS) * free
    best = jnp.argmin(jax.vmap(cost)(jax.lax.stop_gradient(subsets)))
    return solution(subsets[best]) / size


def full_from_amplitudes(
    parameterization: Parameterization, widths: jax.Array, amplitudes: jax.Array, channels: int
) -> jax.Array:
    """A point of the whole problem, shape [P], near these widths and amplitudes: where the polish starts."""
    p = parameterization
    start = jnp.clip(jnp.concatenate([widths, jnp.asarray(p.held[len(widths) :])]), p.lower, p.upper)
    color_r = color_slice("color_r", channels)
    a1 = jnp.maximum(amplitudes[:, A1], 1e-9)
    scale = jnp.where(p.free[SCALE] > 0, a1.mean() / jnp.maximum(start[color_r].mean(), 1e-9), p.held[SCALE])
    color_r_values = jnp.where(p.free[color_r] > 0, a1 / scale, p.held[color_r])
    fresnel_r = jnp.clip(amplitudes[:, A0] / jnp.maximum(scale * color_r_values, 1e-9), 0.0, 0.99)
    entering = scale * (1 - fresnel_r)
    b, d = amplitudes[:, B] / entering, amplitudes[:, D] / entering
    share = jnp.clip((b / jnp.maximum(b + d, 1e-12)).mean(), 0.02, 0.98)
    fresnel_tt = jnp.where(p.free[FRESNEL_TT] > 0, share, p.held[FRESNEL_TT])
    start = start.at[SCALE].set(scale).at[FRESNEL_TT].set(fresnel_tt)
    for name, values in (
        ("color_r", color_r_values),
        ("fresnel_r", fresnel_r),
        ("color_tt", b / jnp.maximum(fresnel_tt, 1e-3)),
        ("color_trt", d / jnp.maximum(1 - fresnel_tt, 1e-3)),
    ):
        start = start.at[color_slice(name, channels)].set(values)
    along_fiber = grazing_slice(len(p.held))
    if along_fiber.start < along_fiber.stop:  # the search knows no change with the angle
        start = start.at[along_fiber].set(jnp.concatenate([start[: len(widths)], start[FRESNEL_TT, None]]))
    return jnp.where(p.free > 0, jnp.clip(start, p.lower, p.upper), expand(p, start))
