"""Fibers migrate between the middle and the border of their ply: Zhao, Luan and Bala 2016, equation 3.

    R_i(theta) = R_min R_i + (R_max - R_min) R_i / 2 (cos(s theta + theta_i0) + 1)

R_min and R_max are factors on the fiber's own radius R_i, theta is the fiber's helix angle, theta_i0 is
uniform in [0, 2 pi). The period along the yarn is fiber pitch / s. Here phases are counted in turns, in
float64, and a period runs from one minimum to the next, so that a peak of another height can replace a
period's own without a step.
"""

from __future__ import annotations

import numpy as np

from .counter_random import PURPOSE_MIGRATION, pcg4d, uniform


def migration_phase(seed: int, yarn: np.ndarray, fiber: np.ndarray) -> np.ndarray:
    """theta_i0 in turns, in (0, 1), a function of (seed, yarn, fiber)."""
    return uniform(pcg4d(seed + PURPOSE_MIGRATION, yarn, fiber, 0)[0])


def migration_period_index(turns: np.ndarray) -> np.ndarray:
    """Which period a phase [turns] falls in; period n peaks at n turns and ends half a turn away."""
    return np.floor(turns + 0.5).astype(np.int64)


def migration_radius(radius: np.ndarray, turns: np.ndarray, *, low: float, peak: np.ndarray) -> np.ndarray:
    """Radius at a phase [turns], from low * radius to `peak` (R_max R_i, or a loop's)."""
    return low * radius + 0.5 * (peak - low * radius) * (np.cos(2.0 * np.pi * turns) + 1.0)
