"""Statistical tests with a stated error probability. Seeds are fixed, so a passing test stays passing."""

from __future__ import annotations

import math

import numpy as np

from weft.renderer.render import RenderResult

Z_LIMIT = 3.9
"""Two-sided error probability 1e-4 of a normal z."""


def picture_mean(result: RenderResult, *, channel: int = 0) -> tuple[float, float]:
    """Mean of one color over the picture and its standard error (strata make the true one smaller)."""
    values = result.radiance[..., channel].astype(np.float64)
    variance = result.layers[f"variance.{'RGB'[channel]}"].astype(np.float64)
    return values.mean(), math.sqrt(variance.sum()) / values.size


def z_score(result: RenderResult, expected: float, *, channel: int = 0) -> float:
    """How many standard errors the picture's mean is off."""
    mean, error = picture_mean(result, channel=channel)
    return (mean - expected) / error


def welch_z(one: RenderResult, other: RenderResult, *, channel: int = 0) -> float:
    """Difference of two pictures' means in standard errors."""
    (a, error_a), (b, error_b) = picture_mean(one, channel=channel), picture_mean(other, channel=channel)
    return (a - b) / math.hypot(error_a, error_b)
