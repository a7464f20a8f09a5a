"""What a fit found: parameters, how well they are known, and what to think of them. Angles in degrees."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from weft.fiber_model.scattering.parameters import FiberScatteringParameters

from .config import FitConfig
from .identifiability import Degeneracy
from .measurements import Measurements

Array = NDArray[np.float64]
LEVELS = (0.68, 0.95)


@dataclass(frozen=True)
class FittedParameter:
    """One number of the model."""

    name: str
    value: float
    role: str
    """free | fixed | tied"""
    standard_error: float | None
    """None where the data do not determine it; 0 for what is fixed."""
    at_bound: str | None
    """lower | upper: the fit stopped there, and the standard errors of the others take it as fixed."""
    near_bound: bool
    """Within three standard errors of a bound: read the standard error with care."""
    intervals: tuple[tuple[float, float], ...] | None
    """At `LEVELS`; None where there are none."""


@dataclass(frozen=True)
class HeldOutError:
    """Of the model at an inclination of the light that the fit did not see."""

    theta_i_deg: float
    value_count: int
    relative_rms: float
    """Root of Σ (model - value)² / Σ value²."""
    chi2_per_value: float


@dataclass(frozen=True)
class FitResult:
    """Everything that the report says."""

    config: FitConfig
    parameters: FiberScatteringParameters
    scale: float
    """Factor of the measurements that the model does not have: 1 where they know their scale."""
    fitted: tuple[FittedParameter, ...]
    covariance: Array
    """Of all numbers in the order of `fitted`; of use where they are determined."""
    correlations: Array
    """Same shape; zero where either of the two has no error."""
    degeneracies: tuple[Degeneracy, ...]
    chi2: float
    degrees_of_freedom: int
    variance_scale: float
    condition: float
    edm: float
    starts: int
    starts_at_best: int
    held_out: tuple[HeldOutError, ...]
    seen: Measurements
    """What was fitted, after masks and without the held-out angles."""
    model: Array
    """Its values by the fitted parameters, shape of `seen.values`."""
    unseen: Measurements | None
    """What was held out."""
    unseen_model: Array | None
    data_sha256: tuple[tuple[str, str], ...]
    """Name and hash of each file of measurements."""
