"""Tails of the longitudinal lobes: the spherical Cauchy distribution about the specular cone.

Directions around one of the specular cone have the density C (1 + s - cos(alpha))^-2 with alpha the angle
between them and s = width² (Kato and McCullagh 2020, d = 2 and 1 + s = (1 + rho²) / (2 rho)); GGX's normals
fall off with the same power (Walter et al. 2007). All places on the cone taken together give M in closed
form, as d'Eon et al. 2011 did with the von Mises-Fisher distribution: normalized for every theta_o, symmetric
in its two angles, sampled by inversion. Near its middle it is Student's t of two degrees of freedom.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .longitudinal import inclination_about_cone

Array = NDArray[np.float64]


def tail_eval(theta_o: ArrayLike, theta_i: ArrayLike, width: ArrayLike) -> Array:
    """M = s (s + 2) a / (2 (a² - b²)^(3/2)), a = 1 + s + sin sin, b = cos cos; ∫ M cos(theta_i) dtheta_i = 1.

    a - b and a + b are formed without cancellation, where both angles are near a pole too.
    """
    theta_o, theta_i = np.asarray(theta_o, dtype=np.float64), np.asarray(theta_i, dtype=np.float64)
    s = np.asarray(width, dtype=np.float64) ** 2
    near = s + 2 * np.sin(0.5 * (theta_o + theta_i)) ** 2
    far = s + 2 * np.cos(0.5 * (theta_o - theta_i)) ** 2
    return 0.25 * s * (s + 2) * (near + far) / (near * far) ** 1.5


def tail_sample(theta_o: ArrayLike, width: ArrayLike, u1: ArrayLike, u2: ArrayLike) -> Array:
    """theta_i with density M cos(theta_i)."""
    s, u1 = np.asarray(width, dtype=np.float64) ** 2, np.asarray(u1, dtype=np.float64)
    return inclination_about_cone(theta_o, 2 * s * u1 / (s + 2 * (1 - u1)), u2)
