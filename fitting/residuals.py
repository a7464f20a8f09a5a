"""Residuals of measured directions: what the solver squares and sums.

A residual is a frozen, hashable object, called with the parameters (shape [P], see parameterization.py) and
its data, a tuple of arrays; it returns one number per datum in standard deviations. The solver knows no more
of it, so that other data (photographs of a cloth, say) can bring a residual of their own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from weft.fiber_model.scattering.phase_jax import (
    DistinctDirections,
    LobeKinds,
    distinct_directions,
    fiber_phase_eval,
)
from weft.files.errors import InputError

from .measurements import Measurements
from .parameterization import SCALE, lobe_parameters

import jax  # isort: skip  after phase_jax, which switches it to 64 bits
import jax.numpy as jnp  # isort: skip

_NONE: Mapping[str, Any] = {}
SMALLEST = 1e-6
"""Values below this part of the largest are as good as zero to the cube root and the logarithm."""


class Residual(Protocol):
    """Anything a fit can minimize. Hashable: compiled functions are kept per residual."""

    def __call__(self, full: jax.Array, data: Any) -> jax.Array: ...

    def __hash__(self) -> int: ...


class DirectionData(NamedTuple):
    """N measured directions, C channels, ready for the model."""

    directions: DistinctDirections
    factor: jax.Array
    """What f_p is multiplied by to give the measured quantity, shape [N]: 1, or 1 / cos theta_o."""
    values: jax.Array
    """Shape [N, C]."""
    weights: jax.Array
    """1 / sigma on the scale of the loss, shape [N, C]; 0 leaves the datum out."""
    peak: jax.Array
    """Largest value of each channel, shape [C]."""
    held_shapes: dict[str, jax.Array]
    """Tables around the fiber and tails along it that the fit holds, by the names of `LobeParameters`."""


@dataclass(frozen=True)
class DirectionResidual:
    """(T(value) - T(model)) / sigma, T the loss's transform; then held back where it is an outlier."""

    kinds: LobeKinds
    channels: int
    loss: str = "linear"
    robust: str = "none"
    robust_sigmas: float = 2.0

    def __call__(self, full: jax.Array, data: DirectionData) -> jax.Array:
        """Shape [N * C]."""
        return self.hold_back(self.plain(full, data)).ravel()

    def plain(self, full: jax.Array, data: DirectionData) -> jax.Array:
        """Before the robust transform, shape [N, C]."""
        model = predict(self.kinds, self.channels, full, data)
        transformed = [transform(self.loss, y, data.peak) for y in (model, data.values)]
        return data.weights * (transformed[0] - transformed[1])

    def hold_back(self, r: jax.Array) -> jax.Array:
        """sign(r) sqrt(rho(r)), so that half its square is the robust loss."""
        if self.robust == "none":
            return r
        limit = self.robust_sigmas
        if self.robust == "huber":
            far = jnp.maximum(jnp.abs(r), limit)
            return jnp.where(jnp.abs(r) <= limit, r, jnp.sign(r) * jnp.sqrt(limit * (2 * far - limit)))
        squared = jnp.maximum((r / limit) ** 2, 1e-12)  # the root of its logarithm has no slope at zero
        return r * jnp.sqrt(jnp.log1p(squared) / squared)


def predict(kinds: LobeKinds, channels: int, full: jax.Array, data: DirectionData) -> jax.Array:
    """The model's value of the measured quantity, shape [N, C]."""
    lobes = lobe_parameters(full, channels)._replace(**data.held_shapes)
    values = fiber_phase_eval(kinds, lobes, data.directions)
    return full[SCALE] * data.factor[:, None] * values


def transform(loss: str, y: Any, peak: Any) -> Any:
    """y, its cube root, or its logarithm; the latter two bend to straight lines at zero."""
    if loss == "linear":
        return y
    if loss == "cube_root":
        small = SMALLEST * peak
        return jnp.sign(y) * (jnp.cbrt(jnp.abs(y) + small) - jnp.cbrt(small))
    floor = 1e3 * SMALLEST * peak
    return jnp.sign(y) * jnp.log1p(jnp.abs(y) / floor)


def transform_slope(loss: str, y: Any, peak: Any) -> Any:
    """d transform / dy, in numpy: carries sigma over to the scale of the loss."""
    if loss == "linear":
        return np.ones_like(y)
    if loss == "cube_root":
        return (np.abs(y) + SMALLEST * peak) ** (-2 / 3) / 3
    return 1 / (1e3 * SMALLEST * peak + np.abs(y))


def direction_data(measurements: Measurements, held_shapes: Mapping[str, Any] = _NONE) -> DirectionData:
    """With weights of one; noise.py gives the right ones."""
    if measurements.quantity == "brdf":
        raise InputError(
            "fit: the measurements are of a surface (quantity 'brdf'); the fiber's lobes need "
            "'phase_function' or 'bcsdf'"
        )
    cos_o = np.cos(measurements.theta_o)
    if measurements.quantity == "bcsdf" and (cos_o < 1e-6).any():
        raise InputError("fit: a detector along the fiber (theta_o = 90 deg) sees no finite BCSDF; mask it")
    factor = 1 / cos_o if measurements.quantity == "bcsdf" else np.ones_like(cos_o)
    directions = distinct_directions(
        measurements.theta_i, measurements.theta_o, measurements.phi_o - measurements.phi_i
    )
    values = measurements.values
    peak = np.maximum(np.abs(values).max(axis=0), np.finfo(float).tiny)
    padded = DistinctDirections(*map(_padded, directions))
    weights = _padded(np.ones_like(values), with_zeros=True)
    held = {name: jnp.asarray(table, float) for name, table in held_shapes.items()}
    return DirectionData(padded, _padded(factor), _padded(values), weights, jnp.asarray(peak), held)


def _padded(array: Any, *, with_zeros: bool = False) -> jax.Array:
    """Longer by repeating the last row (or by zeros) to one of a few lengths.

    Functions compile per length; so measurements of about the same size share what was compiled.
    """
    array = np.asarray(array)
    missing = _length(len(array)) - len(array)
    filling = np.zeros_like(array[:1]) if with_zeros else array[-1:]
    return jnp.asarray(np.concatenate([array, np.repeat(filling, missing, axis=0)]))


def _length(count: int) -> int:
    """The next of 16, 20, 24, 28, 32, 40, ...: at most a quarter more than asked for."""
    step = max(2 ** (max(count - 1, 1).bit_length() - 3), 4)
    return -(-count // step) * step
