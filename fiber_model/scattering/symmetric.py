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

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

MARGINALS = ("base", "entering", "grazing")
TABLE_CELLS = 64
"""Cells of t = sqrt(1 - |theta| / 90°) in [0, 1]: dense at the pole, where q bends within a width beta."""

_HALF_PI = np.pi / 2
_SETTLED = 1e-14
_MAX_ROUNDS = 100
_SAMPLES_AT_ONCE = 16_384


@dataclass(frozen=True)
class SymmetricLobe:
    """ln q and its slope d ln q / dt at the nodes t = 0, 1/TABLE_CELLS, …, 1."""

    beta: float
    marginal: str
    log_q: Array
    slope: Array


def marginal_energy(marginal: str, cos_theta: ArrayLike) -> Array:
    """a(theta) in [0, 1]."""
    cos_theta = np.minimum(np.asarray(cos_theta, dtype=np.float64), 1.0)
    if marginal == "base":
        return np.ones_like(cos_theta)
    rise = (1 - cos_theta) ** 5
    return rise if marginal == "grazing" else 1 - rise


@lru_cache(maxsize=256)
def symmetric_lobe(marginal: str, beta: float) -> SymmetricLobe:
    """Scale the lobe, then tabulate it. 1 to 200 ms, the narrower the longer."""
    theta, weight = _half_circle_quadrature(beta)
    energy = weight * np.cos(theta) ** 2 * marginal_energy(marginal, np.cos(theta))
    kernel = (_normal(theta[:, None] - theta, beta) + _normal(theta[:, None] + theta, beta)) * energy
    q = 1 / np.cos(theta)  # the limit of a narrow lobe, up to the square root of a
    for _ in range(_MAX_ROUNDS):
        # geometric mean of the old q and 1 / (kernel q): the error at least halves, as the kernel is positive
        scaled = np.sqrt(q / _applied(kernel, q))
        change = np.abs(scaled / q - 1).max()
        q = scaled
        if change < _SETTLED:
            break
    nodes = np.linspace(0, 1, TABLE_CELLS + 1)
    at = _HALF_PI * (1 - nodes**2)
    less, more = at[:, None] - theta, at[:, None] + theta
    mass = energy * q
    inverse = _applied(_normal(less, beta) + _normal(more, beta), mass)
    derivative = -_applied(less * _normal(less, beta) + more * _normal(more, beta), mass) / beta**2
    # d ln q / dt = -(inverse' / inverse) dtheta/dt
    return SymmetricLobe(beta, marginal, -np.log(inverse), np.pi * nodes * derivative / inverse)


def _applied(matrix: Array, vector: Array) -> Array:
    """matrix @ vector summed by one thread: the same bits on every machine's BLAS, and no threads to wake."""
    return np.einsum("ij,j->i", matrix, vector)


def _normal(deviation: Array, beta: float) -> Array:
    return np.exp(-0.5 * (deviation / beta) ** 2) / (beta * np.sqrt(2 * np.pi))


def _half_circle_quadrature(beta: float) -> tuple[Array, Array]:
    """Gauss-Legendre on [0, pi/2] in panels no wider than beta; q and a are even."""
    panels = int(np.ceil(_HALF_PI / min(beta, 0.12)))
    nodes, weights = np.polynomial.legendre.leggauss(8)
    half = 0.5 * _HALF_PI / panels
    middle = half * (2 * np.arange(panels) + 1)
    return (middle[:, None] + half * nodes).ravel(), np.tile(half * weights, panels)


def log_q_at(lobe: SymmetricLobe, theta: ArrayLike) -> Array:
    """ln q(theta), the cubic Hermite interpolant of the table."""
    t = np.sqrt(np.clip(1 - np.abs(np.asarray(theta, dtype=np.float64)) / _HALF_PI, 0, 1))
    cell = np.minimum((t * TABLE_CELLS).astype(np.int64), TABLE_CELLS - 1)
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
    return np.exp(exponent) * marginal_energy(marginal, cos_i) * cos_i / (beta * np.sqrt(2 * np.pi))


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
