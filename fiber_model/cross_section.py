"""Where the fibers lie in the cross-section of their ply: Zhao, Luan and Bala 2016, equations 1, 9 and 10.

The ply's cross-section is the unit disc. The density of fibers at distance R from its center is proportional
to

    p(R) = (1 - 2 epsilon) ((e - e^R) / (e - 1))^beta + epsilon,

so the density of the distance itself is 2 R p(R) / q, with q the integral of 2 R p(R) over [0, 1].
"""

from __future__ import annotations

import numpy as np

from .counter_random import PURPOSE_CROSS_SECTION, pcg4d, uniform

LARGEST_RADIUS = 1.0 - 2.0**-20
"""R lies in [0, 1); draws in the disc stay below this."""


def cross_section_density(radius: np.ndarray, *, epsilon: float, beta: float) -> np.ndarray:
    """p(R) [1], not normalized, for R in [0, 1] (equation 1)."""
    falloff = np.clip((np.e - np.exp(radius)) / (np.e - 1.0), 0.0, 1.0)
    return (1.0 - 2.0 * epsilon) * falloff**beta + epsilon


def radius_cdf(radius: np.ndarray, *, epsilon: float, beta: float, steps: int = 200_001) -> np.ndarray:
    """Part of the fibers within R of the ply's center: the integral of 2 R p(R) / q (equations 9 and 10)."""
    grid = np.linspace(0.0, 1.0, steps)
    middle = 0.5 * (grid[1:] + grid[:-1])
    mass = 2.0 * middle * cross_section_density(middle, epsilon=epsilon, beta=beta)
    below = np.concatenate([[0.0], np.cumsum(mass)])
    return np.interp(radius, grid, below / below[-1])


def sample_cross_section(
    seed: int, yarn: np.ndarray, fiber: np.ndarray, *, epsilon: float, beta: float
) -> tuple[np.ndarray, np.ndarray]:
    """Distance R_i [1] and angle theta_i [rad] of fibers, by rejection from the unit disc as in section 3.1.

    A function of (seed, yarn, fiber); both indices have shape [fiber_count]. Draw k of a fiber uses event k
    of its key. The densest point p(0) = 1 - epsilon bounds p where epsilon <= 1/2; else the border's p(1) =
    epsilon does.
    """
    radius, angle = np.zeros(len(yarn)), np.zeros(len(yarn))
    waiting = np.arange(len(yarn))
    largest = max(1.0 - epsilon, epsilon)
    for draw in range(1000):
        words = pcg4d(seed + PURPOSE_CROSS_SECTION, yarn[waiting], fiber[waiting], draw)
        u_radius, u_angle, u_accept = (uniform(word) for word in words[:3])
        distance = np.sqrt(u_radius)
        density = cross_section_density(distance, epsilon=epsilon, beta=beta)
        accepted = (u_accept * largest < density) & (distance < LARGEST_RADIUS)
        radius[waiting[accepted]] = distance[accepted]
        angle[waiting[accepted]] = 2.0 * np.pi * u_angle[accepted]
        waiting = waiting[~accepted]
        if len(waiting) == 0:
            break
    return radius, angle
