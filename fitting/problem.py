"""One fit's data, parameters and residual, and the steps that need all three."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from weft.files.errors import InputError

from . import noise as noises
from .config import FitConfig, StatedNoise
from .measurements import Measurements
from .parameterization import (
    FRESNEL_TT,
    Parameterization,
    build_parameterization,
    color_slice,
    lobe_kinds,
)
from .projected import free_jacobian
from .residuals import DirectionData, DirectionResidual, direction_data, predict
from .solve import Solution, polish_best, random_starts, solve
from .uncertainty import Uncertainty, estimate

import jax.numpy as jnp  # isort: skip  after phase_jax, which switches it to 64 bits

Array = NDArray[np.float64]

REWEIGHTINGS = 3
"""Rounds of sigma from the fitted values; each changes the fit by a small part of the one before."""


class FitProblem:
    """One fit's residual, parameters and data; `data` carries the weights of the moment."""

    def __init__(self, config: FitConfig, seen: Measurements) -> None:
        self.config, self.seen = config, seen
        self.channels = seen.values.shape[1]
        if self.channels not in (1, 3):
            raise InputError(f"fit: the measurements have {self.channels} channels; need one, or three (RGB)")
        self.noise = noises.chosen_noise(config.noise, seen)
        if isinstance(self.noise, StatedNoise) and seen.sigma is None:
            raise InputError('fit: noise is "stated", but the measurements state no sigma')
        self.parameterization = build_parameterization(config, self.channels, scale_known=seen.scale_known)
        self.residual = DirectionResidual(
            lobe_kinds(config), self.channels, config.loss, config.robust, config.robust_sigmas
        )
        self.data = self.weighted(direction_data(seen, config.held_shapes), seen.values)
        _refuse_too_few(seen, self.parameterization)

    def weighted(self, data: DirectionData, expected: Array) -> DirectionData:
        weights = noises.weights(self.noise, self.config.loss, self.seen, data, expected)
        return data._replace(weights=jnp.asarray(weights))

    def solve(self) -> Solution:
        starts = random_starts(self.parameterization, self.config.starts, self.config.seed)
        solution = solve(self.residual, self.parameterization, self.data, starts)
        if self.config.brightest_tt:
            solution = self._with_brightest_tt(solution)
        if noises.follows_model(self.noise):
            for _ in range(REWEIGHTINGS):
                self.data = self.weighted(self.data, self.predicted(solution.x))
                solution = self.polished(solution)
        return solution

    def polished(self, solution: Solution) -> Solution:
        end = polish_best(self.residual, self.parameterization, self.data, solution.x[None])
        return solution._replace(
            x=np.asarray(end.x), cost=float(end.cost), edm=float(end.edm), jacobian=np.asarray(end.jacobian)
        )

    def _with_brightest_tt(self, solution: Solution) -> Solution:
        """Move along the degeneracy of C_TT and F_TT until the largest C_TT is one, and hold it there."""
        x = solution.x.copy()
        tt, trt = (color_slice(name, self.channels) for name in ("color_tt", "color_trt"))
        brightest, t = tt.start + int(np.argmax(x[tt])), x[FRESNEL_TT]
        factor = 1 / max(x[brightest], 1e-6)
        x[tt] *= factor
        x[FRESNEL_TT] = t / factor
        x[trt] *= (1 - t) / max(1 - x[FRESNEL_TT], 1e-6)
        self.parameterization.held[brightest] = 1.0
        self.parameterization.free[brightest] = 0.0
        return self.polished(solution._replace(x=x))

    def predicted(self, x: Array) -> Array:
        """The model's values, padding and all, shape [padded N, C]."""
        return np.asarray(predict(self.residual.kinds, self.channels, jnp.asarray(x), self.data))

    def residuals(self, x: Array) -> Array:
        """Before the robust transform, shape [padded N * C]."""
        return np.asarray(self.residual.plain(jnp.asarray(x), self.data)).ravel()

    @property
    def absolute(self) -> bool:
        if self.config.errors != "auto":
            return self.config.errors == "absolute"
        return isinstance(self.noise, StatedNoise)

    def jacobian(self, solution: Solution) -> Array:
        """Of the residuals before the robust transform, shape [padded N * C, P]."""
        if self.config.robust == "none":
            return solution.jacobian
        plain = replace(self.residual, robust="none")
        return np.asarray(free_jacobian(plain, self.parameterization, self.data, jnp.asarray(solution.x)))

    def uncertainty(self, solution: Solution, jacobian: Array) -> Uncertainty:
        return estimate(
            self.residual,
            self.parameterization,
            solution.x,
            jacobian,
            self.residuals(solution.x),
            absolute=self.absolute,
        )


def _refuse_too_few(seen: Measurements, parameterization: Parameterization) -> None:
    count, free = seen.values.size, int(parameterization.free.sum())
    if count <= free:
        raise InputError(f"fit: {count} values cannot determine {free} parameters")
