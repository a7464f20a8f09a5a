"""Directions over a surface as unit vectors, normal z, and as the angles of `Measurements`."""

from __future__ import annotations

import numpy as np

from .measurements import Array


def vectors(theta: Array, phi: Array) -> Array:
    """Unit vectors, shape [N, 3], of angles from the normal and around it."""
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=1)


def angles(directions: Array) -> tuple[Array, Array]:
    """theta and phi, each of shape [N], of vectors of shape [N, 3]; phi in (-pi, pi]."""
    x, y, z = directions.T
    return np.arctan2(np.hypot(x, y), z), np.arctan2(y, x)
