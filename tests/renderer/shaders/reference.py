"""numpy twins of small shader pieces: hashes and textbook phase functions."""

from __future__ import annotations

import numpy as np


def pcg4d(v: np.ndarray) -> np.ndarray:
    """Four 32-bit hashes, [..., 4] uint32 (Jarzynski and Olano 2020, listing of pcg4d)."""
    x, y, z, w = np.moveaxis(v * np.uint32(1664525) + np.uint32(1013904223), -1, 0)
    x, y, z, w = _pcg4d_mix(x, y, z, w)
    x, y, z, w = (part ^ (part >> np.uint32(16)) for part in (x, y, z, w))
    return np.stack(_pcg4d_mix(x, y, z, w), axis=-1)


def _pcg4d_mix(x, y, z, w):
    x = x + y * w
    y = y + z * x
    z = z + x * y
    w = w + y * z
    return x, y, z, w


def henyey_greenstein(wo: np.ndarray, wi: np.ndarray, g: float) -> np.ndarray:
    """Per steradian; forward scattering (g > 0) is wi = -wo."""
    cos_turn = -(np.asarray(wo, np.float64) * wi).sum(axis=-1)
    return (1 - g**2) / (4 * np.pi * (1 + g**2 - 2 * g * cos_turn) ** 1.5)


def sggx(wo: np.ndarray, wi: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Specular SGGX phase function for a symmetric matrix S [3, 3] (Heitz et al. 2015)."""
    half = np.asarray(wo, np.float64) + wi
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    shape = np.einsum("...i,ij,...j", half, np.linalg.inv(matrix), half)
    normals = 1 / (np.pi * np.sqrt(np.linalg.det(matrix)) * shape**2)
    area = np.sqrt(np.einsum("...i,ij,...j", wo, matrix, wo))
    return normals / (4 * area)
