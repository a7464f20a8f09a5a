"""Azimuthal lobes N(phi) of the fiber phase function, normalized so that ∫ N dphi = 1 over the circle.

phi [rad] is measured from the center of the lobe. Two kinds with width gamma: the normal distribution wrapped
around the circle (exactly sampled by a Gaussian), and the von Mises distribution with kappa = 1/gamma².
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

_VON_MISES_CELLS = 2048


def wrapped_normal_eval(phi: ArrayLike, gamma: float | Array) -> Array:
    """Sum of Gaussians 2 pi apart where it converges fast, its Fourier series (Poisson sum) elsewhere."""
    phi = np.asarray(phi, dtype=np.float64)
    if np.ndim(gamma):
        return _wrapped_normals(phi, np.asarray(gamma))
    phi = phi - 2 * np.pi * np.round(phi / (2 * np.pi))
    if gamma < np.sqrt(np.pi):
        turns = 2 * np.pi * np.arange(-4, 5)
        images = np.exp(-0.5 * ((phi[..., None] + turns) / gamma) ** 2)
        return images.sum(axis=-1) / (gamma * np.sqrt(2 * np.pi))
    n = np.arange(1, 8)
    waves = np.exp(-0.5 * (n * gamma) ** 2) * np.cos(n * phi[..., None])
    return (1 + 2 * waves.sum(axis=-1)) / (2 * np.pi)


def _wrapped_normals(phi: Array, gamma: Array) -> Array:
    """The same with a width for each angle, shape of both broadcast together."""
    phi, gamma = np.broadcast_arrays(phi - 2 * np.pi * np.round(phi / (2 * np.pi)), gamma)
    turns = 2 * np.pi * np.arange(-4, 5)
    images = np.exp(-0.5 * ((phi[..., None] + turns) / gamma[..., None]) ** 2).sum(axis=-1)
    n = np.arange(1, 8)
    waves = (np.exp(-0.5 * (n * gamma[..., None]) ** 2) * np.cos(n * phi[..., None])).sum(axis=-1)
    narrow = gamma < np.sqrt(np.pi)
    return np.where(narrow, images / (gamma * np.sqrt(2 * np.pi)), (1 + 2 * waves) / (2 * np.pi))


def wrapped_normal_sample(gamma: float | Array, u: ArrayLike) -> Array:
    from scipy import special  # only here: it takes a fifth of a second to start

    return gamma * special.ndtri(np.asarray(u, dtype=np.float64))


def von_mises_eval(phi: ArrayLike, gamma: float | Array) -> Array:
    from scipy import special  # only here: it takes a fifth of a second to start

    kappa = gamma**-2.0
    drop = 2 * np.sin(0.5 * np.asarray(phi, dtype=np.float64)) ** 2  # 1 - cos(phi) without cancellation
    return np.exp(-kappa * drop) / (2 * np.pi * special.i0e(kappa))


@lru_cache(maxsize=8)
def _von_mises_cumulative(gamma: float) -> tuple[Array, Array]:
    """Cell edges on [0, pi] and the cumulative probability of |phi| there, by Gauss-Legendre in each cell."""
    edges = np.pi * np.linspace(0, 1, _VON_MISES_CELLS + 1)
    nodes, weights = np.polynomial.legendre.leggauss(8)
    width = edges[1] - edges[0]
    phi = edges[:-1, None] + 0.5 * width * (nodes + 1)
    mass = width * (von_mises_eval(phi, gamma) * weights).sum(axis=1)
    return edges, np.concatenate([[0.0], np.cumsum(mass) / mass.sum()])


def von_mises_sample(gamma: float | Array, u: ArrayLike) -> Array:
    """Invert the cumulative distribution: find the cell, then Newton steps with quadrature of the rest.

    A table per width: where gamma is an array, once for each of its distinct values.
    """
    if not isinstance(gamma, float):
        gammas, numbers = np.broadcast_arrays(gamma, u)
        phi = np.empty(numbers.shape)
        for one in np.unique(gammas):
            phi[gammas == one] = von_mises_sample(float(one), numbers[gammas == one])
        return phi
    signed = 2 * np.asarray(u, dtype=np.float64) - 1
    edges, cumulative = _von_mises_cumulative(gamma)
    cell = np.clip(np.searchsorted(cumulative, np.abs(signed), side="right") - 1, 0, _VON_MISES_CELLS - 1)
    left, missing = edges[cell], np.abs(signed) - cumulative[cell]
    nodes, weights = np.polynomial.legendre.leggauss(8)
    width = edges[1] - edges[0]
    step = np.clip(missing / (2 * von_mises_eval(left + 0.5 * width, gamma)), 0, width)
    for _ in range(6):
        inside = von_mises_eval(left[..., None] + 0.5 * step[..., None] * (nodes + 1), gamma)
        mass = step * (inside * weights).sum(axis=-1)
        step = np.clip(step - (mass - missing) / (2 * von_mises_eval(left + step, gamma)), 0, width)
    return np.sign(signed) * (left + step)
