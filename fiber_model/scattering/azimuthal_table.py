"""Azimuthal lobes N(phi) given by a table: symmetric, piecewise linear, normalized so that ∫ N dphi = 1.

A row holds densities at equal steps of the angle from the lobe's center, 0 to 180 degrees, in any unit.
Fibers lie in a yarn turned by any angle around themselves. Averaged over these turns, N depends on the
difference of the two azimuths alone, and is even in it on the specular cone, even where the cross-section has
no mirror plane: exchanging light and eye (reciprocity) changes the sign of that difference, and mirroring the
fiber along its axis gives the inclinations back. Where a table has several rows, they belong to light at
equal steps of 1 - cos(theta_o), from a right angle to light along the fiber; between, two rows are mixed.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .parameters import Table

Array = NDArray[np.float64]


@lru_cache(maxsize=256)
def table_densities(table: Table) -> Array:
    """N at the knots, each row normalized, shape [rows, knots]."""
    rows = np.array(table, dtype=np.float64)
    rows /= rows.max(axis=1, keepdims=True)  # so that no sum overflows
    return rows / (rows @ knot_masses(rows.shape[1]))[:, None]


def knot_masses(knots: int) -> Array:
    """∫ over the circle of the hat function of each knot and its mirror image, shape [knots]."""
    masses = np.full(knots, 2 * np.pi / (knots - 1))
    masses[[0, -1]] /= 2
    return masses


def row_shares(rows: int, cos_o: ArrayLike) -> Array:
    """How much of each row makes N at this inclination, shape [..., rows]; two neighbors, summing to one."""
    place = (rows - 1) * (1 - np.minimum(np.asarray(cos_o, dtype=np.float64), 1.0))
    return np.clip(1 - np.abs(place[..., None] - np.arange(rows)), 0, None)


def table_eval(phi: ArrayLike, table: Table, cos_o: ArrayLike) -> Array:
    """N at phi [rad] from the lobe's center; the shapes of `phi` and `cos_o` go together."""
    densities = table_densities(table)
    phi, cos_o = np.broadcast_arrays(phi, cos_o)
    place = np.abs(phi - 2 * np.pi * np.round(phi / (2 * np.pi))) * ((densities.shape[1] - 1) / np.pi)
    cell = np.minimum(place.astype(np.int64), densities.shape[1] - 2)
    part = place - cell
    of_rows = densities[:, cell] * (1 - part) + densities[:, cell + 1] * part
    return np.einsum("...r,r...->...", row_shares(len(densities), cos_o), of_rows)


def table_sample(table: Table, cos_o: ArrayLike, u: ArrayLike) -> Array:
    """Angles from the center with density N, from one uniform number each: a row, then its inverse CDF."""
    densities = table_densities(table)
    cos_o, u = np.broadcast_arrays(cos_o, np.asarray(u, dtype=np.float64))
    shares = row_shares(len(densities), cos_o)
    edges = np.cumsum(shares, axis=-1)
    edges[..., -1] = 1.0
    row = (u[..., None] >= edges[..., :-1]).sum(axis=-1)
    share = np.take_along_axis(shares, row[..., None], axis=-1)[..., 0]
    below = np.take_along_axis(edges, row[..., None], axis=-1)[..., 0] - share
    rest = np.clip((u - below) / np.where(share > 0, share, 1.0), 0, 1)
    phi = np.empty(u.shape)
    for one, density in enumerate(densities):
        phi[row == one] = _row_sample(density, rest[row == one])
    return phi


def _row_sample(density: Array, u: Array) -> Array:
    """In a cell of density a + (b - a) x, x in [0, 1], the mass m = a x + (b - a) x² / 2 is inverted."""
    signed, step = 2 * u - 1, np.pi / (len(density) - 1)
    masses = step * (density[:-1] + density[1:])  # of both sides of the circle
    edges = np.concatenate([[0.0], np.cumsum(masses) / masses.sum()])
    cell = np.clip(np.searchsorted(edges, np.abs(signed), side="right") - 1, 0, len(masses) - 1)
    a, b = density[cell], density[cell + 1]
    missing = np.clip((np.abs(signed) - edges[cell]) / (2 * step), 0, 0.5 * (a + b))
    root = np.sqrt(np.maximum(a * a + 2 * (b - a) * missing, 0))
    x = np.divide(2 * missing, a + root, out=np.zeros_like(missing), where=a + root > 0)
    return np.sign(signed) * step * (cell + np.clip(x, 0, 1))


def nearest_width(table: Table, row: int) -> float:
    """gamma [rad] of the wrapped normal with this row's ∫ N cos(phi) dphi, within 2 and 300 degrees."""
    density = table_densities(table)[row]
    step = np.pi / (len(density) - 1)
    hats = 2 * (1 - np.cos(step)) / step**2 * np.cos(step * np.arange(len(density)))
    resultant = float(density * knot_masses(len(density)) @ hats)
    widest = np.radians(300.0)
    gamma = np.sqrt(-2 * np.log(np.clip(resultant, np.exp(-0.5 * widest**2), 1.0)))
    return float(np.clip(gamma, np.radians(2.0), widest))
