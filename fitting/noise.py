"""What a datum weighs: 1 / sigma on the scale of the loss."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .config import RelativeNoise, StatedNoise, UniformNoise
from .measurements import Measurements
from .residuals import DirectionData, transform_slope

Array = NDArray[np.float64]
Noise = StatedNoise | RelativeNoise | UniformNoise


def chosen_noise(noise: Noise | None, measurements: Measurements) -> Noise:
    """The config's, or what suits the measurements."""
    if noise is not None:
        return noise
    return StatedNoise() if measurements.sigma is not None else RelativeNoise()


def follows_model(noise: Noise) -> bool:
    """Whether sigma depends on the value: then it must come from the fitted one, since noisy values that
    happen to be low would weigh more than those that happen to be high and pull the fit down."""
    return isinstance(noise, RelativeNoise)


def weights(
    noise: Noise, loss: str, measurements: Measurements, data: DirectionData, expected: Array
) -> Array:
    """Shape of the padded values, from the `expected` values; zero on padding."""
    count = len(measurements)
    result = np.zeros(data.values.shape)
    sigma = standard_deviations(noise, measurements, np.asarray(data.peak), np.asarray(expected)[:count])
    if sigma is None:
        result[:count] = 1.0
        return result
    slope = transform_slope(loss, np.asarray(expected)[:count], np.asarray(data.peak))
    result[:count] = 1 / (sigma * slope)
    return result


def standard_deviations(
    noise: Noise, measurements: Measurements, peak: Array, expected: Array
) -> Array | None:
    """sigma of the values, shape [N, C]; None where it is uniform and unknown."""
    if isinstance(noise, UniformNoise):
        return None
    if isinstance(noise, RelativeNoise):
        return np.hypot(noise.relative * expected, noise.floor * peak)
    assert measurements.sigma is not None, "the config asked for stated noise; fit.py refuses it without"
    return measurements.sigma
