"""The smooth round fiber, solved: the series of orders of Marschner et al. 2003 (R, TT, TRT, …).

Light that meets the cylinder at offset h (of its radius, in [-1, 1]) refracts in the normal plane as if the
fiber had the index eta' of Bravais; every order p leaves at the azimuth Phi_p(h) with the attenuation A_p(h).
The Fresnel factors are those of the true angle in space, cos theta cos gamma_i.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .dielectric import fresnel
from .histogram import ORDERS, Array

_MOST_ORDERS = 200
_FAINT = 1e-8
"""Light of an order that ends the sum of azimuths: what is left is a few times as much."""


@dataclass(frozen=True)
class SmoothCylinder:
    """`absorption` is per radius of the fiber: absorption coefficient times radius [1]."""

    refractive_index: float
    absorption: float = 0.0

    def attenuations(self, theta_i: float, h: Array, count: int) -> Array:
        """A_0 … A_{count-1} at offsets h [N]: part of the light that leaves in each order, [count, N]."""
        eta = self.refractive_index
        reflectance = fresnel(np.cos(theta_i) * np.sqrt(1 - h**2), eta)
        sin_gamma_t = h / self._bravais_index(theta_i)
        cos_theta_t = np.sqrt(1 - (np.sin(theta_i) / eta) ** 2)
        left = np.exp(-2 * self.absorption * np.sqrt(1 - sin_gamma_t**2) / cos_theta_t)
        p = np.arange(1, count)[:, None]
        inner = (1 - reflectance) ** 2 * reflectance ** (p - 1) * left**p
        return np.concatenate([reflectance[None], inner])

    def azimuths(self, theta_i: float, h: Array, count: int) -> Array:
        """Phi_0 … Phi_{count-1}: azimuths of the light that leaves, from the light's [rad], [count, N]."""
        gamma_t = np.arcsin(h / self._bravais_index(theta_i))
        p = np.arange(count)[:, None]
        return 2 * p * gamma_t - 2 * np.arcsin(h) + p * np.pi

    def energies(self, theta_i: float) -> Array:
        """Of R, TT, TRT and the rest (a geometric series), shape [4]; Gauss-Legendre over gamma_i."""
        nodes, weights = np.polynomial.legendre.leggauss(400)
        gamma = 0.5 * np.pi * nodes
        a = self.attenuations(theta_i, np.sin(gamma), 4)
        ratio = np.divide(a[3], a[2], out=np.zeros_like(gamma), where=a[2] > 0)
        a[3] /= 1 - ratio
        return np.asarray(a @ (0.25 * np.pi * weights * np.cos(gamma)))

    def azimuthal_masses(self, theta_i: float, phi_edges: Array, *, offsets: int = 100_000) -> Array:
        """Light of each order that leaves between neighboring edges (one turn, evenly spaced): [4, P].

        By stratified offsets, evenly in gamma_i; exact to about 1 / offsets of an order's energy in each bin.
        """
        gamma = (np.arange(offsets) + 0.5) / offsets * np.pi - np.pi / 2
        weight = 0.5 * np.cos(gamma) * np.pi / offsets
        light = self.attenuations(theta_i, np.sin(gamma), 4) * weight
        ratio = np.divide(light[3], light[2], out=np.zeros_like(gamma), where=light[2] > 0)
        first, second = self.azimuths(theta_i, np.sin(gamma), 2)
        bins = len(phi_edges) - 1
        masses = np.zeros((len(ORDERS), bins))
        for p in range(_MOST_ORDERS):
            leaving = light[p] if p < 3 else light[3] * ratio ** (p - 3)
            turned = np.mod(first + p * (second - first) - phi_edges[0], 2 * np.pi)
            column = np.minimum((turned * (bins / (2 * np.pi))).astype(np.int64), bins - 1)
            masses[min(p, 3)] += np.bincount(column, leaving, bins)
            if leaving.sum() < _FAINT:
                break
        return masses

    def _bravais_index(self, theta_i: float) -> float:
        return float(np.sqrt(self.refractive_index**2 - np.sin(theta_i) ** 2) / np.cos(theta_i))
