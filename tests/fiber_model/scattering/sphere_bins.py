"""Bins of nearly equal probability on the sphere, made from a pdf's own integrals, for chi-square tests.

The sphere is cut into cells by knots placed where the lobes are; each cell's mass is a Gauss-Legendre
product. Bins are unions of cells: strips of equal probability in theta, then, strip by strip, in phi; so
narrow lobes are resolved.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import stats

from weft.fiber_model.scattering.parameters import FiberScatteringParameters
from weft.fiber_model.scattering.phase import azimuthal_widths, fiber_phase_pdf, longitudinal_widths, tails

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)


def direction(theta, phi):
    """Unit vectors [..., 3] at inclination theta and azimuth phi around the fiber x."""
    theta, phi = np.broadcast_arrays(theta, phi)
    return np.stack([np.sin(theta), np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi)], axis=-1)


def theta_knots(parameters: FiberScatteringParameters, theta_o: float, *, steps: int = 36) -> np.ndarray:
    around = [
        -theta_o + beta * np.linspace(-7, 7, steps) for beta in longitudinal_widths(parameters, theta_o)
    ]
    widths = [tail[1] for tail in tails(parameters, theta_o) if tail is not None]
    far = np.concatenate([np.linspace(0, 7, steps), np.geomspace(7, 2000, steps)])
    around += [-theta_o + side * width * far for width in widths for side in (-1, 1)]
    if widths:  # a tail goes over the pole
        around += [np.pi / 2 - np.geomspace(1e-5, 0.2, steps), np.geomspace(1e-5, 0.2, steps) - np.pi / 2]
    return _knots([*around, np.linspace(-1, 1, 31) * np.pi / 2], np.pi / 2)


def phi_knots(parameters: FiberScatteringParameters, theta_o: float, *, steps: int = 36) -> np.ndarray:
    """Angles from the center of the TT lobe."""
    z = np.linspace(-7, 7, steps)
    _, around_tt, width, _ = azimuthal_widths(parameters, theta_o)
    around = [around_tt * z]
    if width is not None:
        around += [np.pi + width * z, -np.pi + width * z]
    around += [np.linspace(-np.pi, np.pi, 2 * len(table[0]) - 1) for table in parameters.tables if table]
    return _knots([*around, np.linspace(-np.pi, np.pi, 25)], np.pi)


def _knots(parts: list[np.ndarray], limit: float) -> np.ndarray:
    knots = np.unique(np.clip(np.concatenate(parts), -limit, limit))
    return knots[np.concatenate([[True], np.diff(knots) > 1e-7])]


def gauss_points(knots: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Abscissas and weights between the knots, each [cells, 4]."""
    half = 0.5 * np.diff(knots)[:, None]
    return 0.5 * (knots[:-1] + knots[1:])[:, None] + half * _NODES, half * _WEIGHTS


def cell_integrals(value: Callable, theta_edges: np.ndarray, phi_edges: np.ndarray) -> np.ndarray:
    """∫ value(theta, phi) cos(theta) over every cell; value is [theta, phi] or [theta, phi, channels]."""
    theta, theta_weight = gauss_points(theta_edges)
    phi, phi_weight = gauss_points(phi_edges)
    values = value(theta.reshape(-1, 1), phi.reshape(1, -1))
    shape = (len(theta), 4, len(phi), 4, *values.shape[2:])
    return np.einsum("iajb...,ia,jb->ij...", values.reshape(shape), theta_weight * np.cos(theta), phi_weight)


@dataclass
class SphereBins:
    theta_edges: np.ndarray
    phi_edges: list[np.ndarray]
    """Sectors of every strip between `theta_edges`."""
    masses: list[np.ndarray]
    sector_edges: np.ndarray
    """Sectors of the whole sphere."""
    sector_masses: np.ndarray

    @property
    def total(self) -> float:
        return sum(strip.sum() for strip in self.masses)

    def p_value(self, theta: np.ndarray, phi: np.ndarray) -> float:
        """The chance of counts as uneven as these if the samples follow the pdf.

        Three of Pearson's chi-squares, corrected by Bonferroni: of all bins, and of strips and of sectors
        alone, which see a slightly wrong width far better.
        """
        strip = np.clip(np.searchsorted(self.theta_edges, theta) - 1, 0, len(self.masses) - 1)
        counts = [_counts(phi[strip == k], edges) for k, edges in enumerate(self.phi_edges)]
        p_values = [
            _chi_square(np.concatenate(counts), np.concatenate(self.masses)),
            _chi_square(np.array([c.sum() for c in counts]), np.array([m.sum() for m in self.masses])),
            _chi_square(_counts(phi, self.sector_edges), self.sector_masses),
        ]
        return min(1.0, 3 * min(p_values))


def _counts(phi: np.ndarray, edges: np.ndarray) -> np.ndarray:
    return np.histogram(np.clip(phi, edges[0], edges[-1]), edges)[0]


def _chi_square(counts: np.ndarray, masses: np.ndarray) -> float:
    if len(masses) == 1:
        return 1.0
    expected = masses / masses.sum() * counts.sum()
    statistic = ((counts - expected) ** 2 / expected).sum()
    return float(stats.chi2.sf(statistic, len(expected) - 1))


def fiber_bins(
    parameters: FiberScatteringParameters, theta_o: float, *, strips: int = 24, sectors: int = 24
) -> SphereBins:
    """Bins for wi, in (theta_i, azimuth from the center of TT), with wo at theta_o and azimuth 0."""
    wo = direction(theta_o, 0.0)
    thetas, phis = theta_knots(parameters, theta_o), phi_knots(parameters, theta_o)
    cells = cell_integrals(
        lambda theta, phi: fiber_phase_pdf(parameters, wo, direction(theta, phi + np.pi)), thetas, phis
    )
    cut = _equal_cut(cells.sum(axis=1), strips)
    phi_edges, masses = [], []
    for begin, end in itertools.pairwise(cut):
        edges, strip = _sectors(cells[begin:end].sum(axis=0), phis, sectors)
        phi_edges.append(edges)
        masses.append(strip)
    return SphereBins(thetas[cut], phi_edges, masses, *_sectors(cells.sum(axis=0), phis, sectors))


def fiber_means(parameters: FiberScatteringParameters, theta_o: float, functions: Callable) -> np.ndarray:
    """∫ pdf functions(theta, phi) over the sphere, one number per function; phi from the center of TT."""
    wo = direction(theta_o, 0.0)

    def weighted(theta, phi):
        pdf = fiber_phase_pdf(parameters, wo, direction(theta, phi + np.pi))
        return np.stack([pdf * value for value in functions(theta, phi)], axis=-1)

    cells = cell_integrals(weighted, theta_knots(parameters, theta_o), phi_knots(parameters, theta_o))
    return cells.sum(axis=(0, 1))


def _sectors(masses: np.ndarray, knots: np.ndarray, parts: int) -> tuple[np.ndarray, np.ndarray]:
    cut = _equal_cut(masses, parts)
    return knots[cut], np.add.reduceat(masses, cut[:-1])


def _equal_cut(masses: np.ndarray, parts: int) -> np.ndarray:
    """Indices of cell borders that split the masses into nearly equal parts, none of them tiny."""
    cumulative = np.concatenate([[0.0], np.cumsum(masses)]) / masses.sum()
    cut = np.unique(np.searchsorted(cumulative, np.linspace(0, 1, parts + 1)[1:-1]))
    full = (cumulative[cut] > 0.3 / parts) & (cumulative[cut] < 1 - 0.3 / parts)
    return np.concatenate([[0], cut[full], [len(masses)]])


def angles_from_tt(wi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """theta_i and the azimuth from pi, in [-pi, pi], of directions wi with wo at azimuth 0."""
    theta = np.arctan2(wi[..., 0], np.hypot(wi[..., 1], wi[..., 2]))
    return theta, np.arctan2(-wi[..., 2], -wi[..., 1])
