"""The reciprocal longitudinal lobe: Sinkhorn-scaled, energy-conserving with a Fresnel factor inside.

A lobe A(theta_o, theta_i) with the energy a(theta_o) for which cos(theta_o) A is symmetric in its angles, the
reciprocity of fibers whose extinction goes with cos(theta), is

    A = a M,   M = q(theta_o) q(theta_i) a(theta_i) g(theta_o + theta_i; beta) cos(theta_i),

g the normal density, if 1/q(theta_o) = ∫ q a(theta) g(theta_o + theta) cos²(theta) dtheta: the scaling of a
symmetric matrix (Sinkhorn 1964) in the continuum. ln q is smooth; kept as a cubic Hermite table, it *is* the
model: reciprocity is exact, the energy right to the table's error (README). Three marginals a:

    base      1                      R at normal incidence
    grazing   s = (1 - cos theta)^5  what Schlick's term adds to R
    entering  1 - s                  TT and TRT

Schlick's F = F_R + (1 - F_R) s makes a_R = C_R (F_R base + (1 - F_R) grazing), 1 - F = (1 - F_R) entering: no
table depends on a color, and the sum of reciprocal lobes is reciprocal, channel by channel.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

MARGINALS = ("base", "entering", "grazing")
TABLE_CELLS = 64
"""Cells of t = sqrt(1 - |theta| / 90°) in [0, 1]: dense at the pole, where q bends within a width beta."""
ROUNDS = 60
"""Each halves the error at least."""

_HALF_PI = np.pi / 2
_SETTLED = 1e-14
_SAMPLES_AT_ONCE = 16_384
_REACH = 9.0
"""The integral over a lobe spans this many widths on each side; beyond lies 2e-19 of a Gaussian."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(64)


@dataclass(frozen=True)
class SymmetricLobe:
    """ln q and its slope d ln q / dt at the nodes t = 0, 1/TABLE_CELLS, …, 1."""

    log_q: Any
    slope: Any


def marginal_energy(marginal: str, cos_theta: Any, xp: Any = np) -> Any:
    """a(theta) in [0, 1]. `xp` is numpy or jax.numpy, here and below."""
    cos_theta = xp.clip(cos_theta, 0.0, 1.0)
    if marginal == "base":
        return xp.ones_like(cos_theta)
    rise = (1 - cos_theta) ** 5
    return rise if marginal == "grazing" else 1 - rise


@lru_cache(maxsize=256)
def symmetric_lobe(marginal: str, beta: float) -> SymmetricLobe:
    """The table of a lobe, scaled until it changes no more; a few milliseconds."""
    integral, lobe = LobeIntegral.around_nodes(marginal, beta), start_lobe(beta)
    for _ in range(ROUNDS):
        before, lobe = lobe, rescaled(lobe, integral)
        if np.abs(lobe.log_q - before.log_q).max() < _SETTLED:
            break
    return lobe


def start_lobe(beta: Any, xp: Any = np) -> SymmetricLobe:
    """q = 1 / hypot(cos theta, beta): about a narrow lobe's limit, up to the square root of a."""
    nodes = np.linspace(0, 1, TABLE_CELLS + 1)
    log_q = -0.5 * xp.log(np.sin(_HALF_PI * nodes**2) ** 2 + beta**2)
    return SymmetricLobe(log_q, xp.zeros_like(log_q))


@dataclass(frozen=True)
class LobeIntegral:
    """∫ q a(theta) g(theta_o - theta) cos²(theta) dtheta at the nodes theta_o, as sums; q is even."""

    theta: Any
    """Points of Gauss-Legendre within reach of each node, shape [TABLE_CELLS + 1, 64]."""
    weight: Any
    derivative_weight: Any
    """The same for the integral's derivative with respect to t of the node."""

    @classmethod
    def around_nodes(cls, marginal: str, beta: Any, xp: Any = np) -> LobeIntegral:
        nodes = np.linspace(0, 1, TABLE_CELLS + 1)[:, None]
        center = _HALF_PI * (1 - nodes**2)
        low = xp.clip(center - _REACH * beta, -_HALF_PI, _HALF_PI)
        high = xp.clip(center + _REACH * beta, -_HALF_PI, _HALF_PI)
        theta = 0.5 * (low + high) + 0.5 * (high - low) * _NODES
        away = (center - theta) / beta
        normal = xp.exp(-0.5 * away**2) / (beta * np.sqrt(2 * np.pi))
        energy = marginal_energy(marginal, xp.cos(theta), xp) * xp.cos(theta) ** 2
        weight = 0.5 * (high - low) * _WEIGHTS * normal * energy
        return cls(theta, weight, weight * away / beta * np.pi * nodes)


def rescaled(lobe: SymmetricLobe, integral: LobeIntegral, xp: Any = np) -> SymmetricLobe:
    """The geometric mean of q and 1 / integral: the error at least halves, since the kernel is positive."""
    q = xp.exp(log_q_at(lobe, integral.theta, xp))
    inverse = (integral.weight * q).sum(axis=1)
    slope = -(integral.derivative_weight * q).sum(axis=1) / inverse
    return SymmetricLobe(0.5 * (lobe.log_q - xp.log(inverse)), 0.5 * (lobe.slope + slope))


def log_q_at(lobe: SymmetricLobe, theta: Any, xp: Any = np) -> Any:
    """ln q(theta), the cubic Hermite interpolant of the table."""
    t = xp.sqrt(xp.clip(1 - xp.abs(theta) / _HALF_PI, 0.0, 1.0))
    cell = xp.minimum((t * TABLE_CELLS).astype(int), TABLE_CELLS - 1)
    f = t * TABLE_CELLS - cell
    left, right = lobe.log_q[cell], lobe.log_q[cell + 1]
    bend_left = lobe.slope[cell] / TABLE_CELLS - (right - left)
    bend_right = (right - left) - lobe.slope[cell + 1] / TABLE_CELLS
    return left + f * (right - left) + f * (1 - f) * ((1 - f) * bend_left + f * bend_right)


def symmetric_eval(theta_o: ArrayLike, theta_i: ArrayLike, beta: float, marginal: str) -> Array:
    """M(theta_o, theta_i); ∫ M cos(theta_i) dtheta_i = 1."""
    theta_o, theta_i = np.asarray(theta_o, dtype=np.float64), np.asarray(theta_i, dtype=np.float64)
    lobe = symmetric_lobe(marginal, beta)
    exponent = log_q_at(lobe, theta_o) + log_q_at(lobe, theta_i) - 0.5 * ((theta_o + theta_i) / beta) ** 2
    cos_i = np.cos(theta_i)
    value: Array = np.exp(exponent) * marginal_energy(marginal, cos_i) * cos_i / (beta * np.sqrt(2 * np.pi))
    return value


def symmetric_sample(theta_o: ArrayLike, beta: float, marginal: str, u: ArrayLike) -> Array:
    """theta_i with density M cos(theta_i), by inverting its cumulative distribution numerically."""
    theta_o, u = np.broadcast_arrays(np.asarray(theta_o, dtype=np.float64), np.asarray(u, dtype=np.float64))
    theta = np.empty(u.size)
    for start in range(0, theta.size, _SAMPLES_AT_ONCE):
        part = slice(start, start + _SAMPLES_AT_ONCE)
        theta[part] = _invert(theta_o.ravel()[part], beta, marginal, u.ravel()[part])
    return theta.reshape(u.shape)


def _invert(theta_o: Array, beta: float, marginal: str, u: Array) -> Array:
    """Find the panel of the wanted probability, then Newton steps kept within it."""
    centers, which = np.unique(theta_o, return_inverse=True)
    edges = np.clip(-centers[:, None] + beta * np.linspace(-9, 9, 31), -_HALF_PI, _HALF_PI)
    masses = _mass(centers[:, None], edges[:, :-1], np.diff(edges, axis=1), beta, marginal)
    cumulative = np.concatenate([np.zeros((len(centers), 1)), np.cumsum(masses, axis=1)], axis=1)
    wanted = u * cumulative[which, -1]
    panel = np.clip((cumulative[which] <= wanted[:, None]).sum(axis=1) - 1, 0, masses.shape[1] - 1)
    left, missing = edges[which, panel], wanted - cumulative[which, panel]
    low, high = np.zeros_like(left), edges[which, panel + 1] - left
    step = 0.5 * high
    for _ in range(60):  # bisection alone would take 50
        excess = _mass(theta_o, left, step, beta, marginal) - missing
        low, high = np.where(excess > 0, low, step), np.where(excess > 0, step, high)
        density = symmetric_eval(theta_o, left + step, beta, marginal) * np.cos(left + step)
        newton = step - excess / np.maximum(density, 1e-300)
        before, step = step, np.where((newton >= low) & (newton <= high), newton, 0.5 * (low + high))
        if np.abs(step - before).max() < 1e-13:
            break
    return left + step


def _mass(theta_o: Array, left: Array, width: Array, beta: float, marginal: str) -> Array:
    """∫ M cos(theta_i) dtheta_i over [left, left + width], no wider than 0.6 beta."""
    nodes, weights = np.polynomial.legendre.leggauss(8)
    theta = left[..., None] + 0.5 * width[..., None] * (nodes + 1)
    value = symmetric_eval(theta_o[..., None], theta, beta, marginal) * np.cos(theta)
    return 0.5 * width * (value * weights).sum(axis=-1)
