"""Longitudinal lobes M(theta_o, theta_i) of the fiber phase function: ∫ M cos(theta_i) dtheta_i = 1.

Angles in radians, measured from the plane normal to the fiber. Two kinds:
`gaussian`: M = g(theta_i; -theta_o, beta) cos(theta_i) / G(theta_o), Khungurn et al. 2015, with G exact;
`vmf`: the von Mises-Fisher lobe of d'Eon et al. 2011, closed form, symmetric in its two angles.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Width = float | Array
"""beta [rad]: one, or one for each angle."""

_HALF_PI = np.pi / 2
_SQRT2 = np.sqrt(2.0)


def _gaussian_cos2_partial(theta: ArrayLike, mean: ArrayLike, beta: Width) -> Array:
    """Antiderivative in theta of g(theta; mean, beta) cos²(theta), up to a constant.

    cos² = (1 + Re exp(2i theta)) / 2; the Gaussian integral of the second term is an erf of complex argument.
    """
    from scipy import special  # only here: it takes a fifth of a second to start

    mean = np.asarray(mean, dtype=np.float64)
    x = (np.asarray(theta, dtype=np.float64) - mean) / (_SQRT2 * beta)
    oscillating = np.exp(2j * mean - 2 * beta**2) * special.erf(x - 1j * _SQRT2 * beta)
    return 0.25 * (special.erf(x) + oscillating.real)


def gaussian_normalization(theta_o: ArrayLike, beta: Width) -> Array:
    """G(theta_o) = ∫ g(theta; -theta_o, beta) cos²(theta) dtheta over the half circle, closed form."""
    mean = -np.asarray(theta_o, dtype=np.float64)
    return _gaussian_cos2_partial(_HALF_PI, mean, beta) - _gaussian_cos2_partial(-_HALF_PI, mean, beta)


def gaussian_eval(theta_o: ArrayLike, theta_i: ArrayLike, beta: Width) -> Array:
    theta_o, theta_i = np.asarray(theta_o, dtype=np.float64), np.asarray(theta_i, dtype=np.float64)
    gauss = np.exp(-0.5 * ((theta_i + theta_o) / beta) ** 2) / (beta * np.sqrt(2 * np.pi))
    return gauss * np.cos(theta_i) / gaussian_normalization(theta_o, beta)


def gaussian_sample(theta_o: ArrayLike, beta: Width, u: ArrayLike) -> Array:
    """theta_i with density M cos(theta_i), by inverting its cumulative distribution."""
    mean, u = np.broadcast_arrays(-np.asarray(theta_o, dtype=np.float64), np.asarray(u, dtype=np.float64))
    start = _gaussian_cos2_partial(-_HALF_PI, mean, beta)
    target = start + u * gaussian_normalization(-mean, beta)
    theta = gaussian_mode(mean, beta).ravel()
    widths = np.broadcast_to(beta, mean.shape).ravel() if np.ndim(beta) else beta
    _invert_gaussian_cos2(theta, mean.ravel(), target.ravel(), widths)
    return theta.reshape(mean.shape)


def _invert_gaussian_cos2(theta: Array, mean: Array, target: Array, beta: Width) -> None:
    """Solve for theta in place: Newton steps, bisection where one would leave the bracket."""
    low, high = np.full(theta.shape, -_HALF_PI), np.full(theta.shape, _HALF_PI)
    open_ = np.arange(theta.size)
    for _ in range(100):  # bisection alone would take 50
        t, center = theta[open_], mean[open_]
        width = beta[open_] if isinstance(beta, np.ndarray) else beta
        excess = _gaussian_cos2_partial(t, center, width) - target[open_]
        high[open_] = np.where(excess > 0, t, high[open_])
        low[open_] = np.where(excess > 0, low[open_], t)
        density = np.exp(-0.5 * ((t - center) / width) ** 2) * np.cos(t) ** 2 / (width * np.sqrt(2 * np.pi))
        newton = t - excess / np.maximum(density, 1e-300)
        inside = (newton >= low[open_]) & (newton <= high[open_])
        theta[open_] = np.where(inside, newton, 0.5 * (low[open_] + high[open_]))
        unsettled = (np.abs(theta[open_] - t) > 1e-12) & (np.abs(excess) > 1e-15)
        open_ = open_[unsettled]
        if open_.size == 0:
            return


def gaussian_mode(mean: ArrayLike, beta: Width) -> Array:
    """Near the mode m of g(theta; mean, beta) cos²(theta): m + 2 beta² tan(m) = mean; cot(y) ≈ 1/y - y/3.

    A start value for solvers and a tangent point for rejection envelopes; neither needs it exact.
    """
    mean = np.asarray(mean, dtype=np.float64)
    stretch = 1 + 2 * beta**2 / 3
    gap = _HALF_PI - np.abs(mean)
    from_pole = (gap + np.sqrt(gap**2 + 8 * beta**2 * stretch)) / (2 * stretch)
    return np.copysign(np.maximum(_HALF_PI - from_pole, 0.0), mean)


def vmf_eval(theta_o: ArrayLike, theta_i: ArrayLike, beta: Width) -> Array:
    """exp(-sin sin / v) I0(cos cos / v) / (2 v sinh(1/v)) with v = beta², arranged not to overflow."""
    from scipy import special  # only here: it takes a fifth of a second to start

    theta_o, theta_i = np.asarray(theta_o, dtype=np.float64), np.asarray(theta_i, dtype=np.float64)
    v = beta**2
    exponent = -2 * np.sin(0.5 * (theta_i + theta_o)) ** 2 / v
    bessel = special.i0e(np.cos(theta_o) * np.cos(theta_i) / v)
    return np.exp(exponent) * bessel / (v * -np.expm1(-2 / v))


def vmf_sample(theta_o: ArrayLike, beta: Width, u1: ArrayLike, u2: ArrayLike) -> Array:
    """Inclination of a von Mises-Fisher direction drawn about the specular cone (d'Eon et al. 2013)."""
    u1 = np.asarray(u1, dtype=np.float64)
    v = beta**2
    return inclination_about_cone(theta_o, -v * np.log(u1 + (1 - u1) * np.exp(-2 / v)), u2)


def inclination_about_cone(theta_o: ArrayLike, drop: Array, u2: ArrayLike) -> Array:
    """Of a direction whose angle to one of the specular cone has the cosine 1 - drop, in a random turn."""
    theta_o = np.asarray(theta_o, dtype=np.float64)
    side = np.sqrt(drop * (2 - drop))
    angle = 2 * np.pi * np.asarray(u2, dtype=np.float64)
    along = -(1 - drop) * np.sin(theta_o) + side * np.cos(angle) * np.cos(theta_o)
    outward = (1 - drop) * np.cos(theta_o) + side * np.cos(angle) * np.sin(theta_o)
    return np.arctan2(along, np.hypot(outward, side * np.sin(angle)))
