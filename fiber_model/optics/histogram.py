"""Where the light goes: scattered light counted in bins of direction, by order, with standard errors.

Bins are centered at multiples of their size, so that the specular cone theta_o = -theta_i of a smooth fiber
lies in the middle of a bin and not on an edge. Each path ends in one bin with weights w, one per channel;
with N paths the estimate of a bin is Σw / (N dω), its variance (Σw²/N - (Σw/N)²) / (N dω²).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ORDERS = ("R", "TT", "TRT", "rest")


@dataclass(frozen=True)
class DirectionBins:
    """T bins of inclination and P of azimuth [rad]; a bin has the solid angle d(sin theta) dphi."""

    theta_edges: Array
    """Shape [T + 1], from -pi/2 to pi/2; the first and the last bin are half as wide."""
    phi_edges: Array
    """Shape [P + 1], one turn; phi = 0 is toward the light, pi is straight on."""

    @property
    def shape(self) -> tuple[int, int]:
        return len(self.theta_edges) - 1, len(self.phi_edges) - 1

    @property
    def theta(self) -> Array:
        """Middles, shape [T]; those of the half bins at the poles are their middles too."""
        return 0.5 * (self.theta_edges[1:] + self.theta_edges[:-1])

    @property
    def phi(self) -> Array:
        """Middles, shape [P]."""
        return 0.5 * (self.phi_edges[1:] + self.phi_edges[:-1])

    @property
    def solid_angles(self) -> Array:
        """Shape [T, P], in steradians."""
        return np.diff(np.sin(self.theta_edges))[:, None] * np.diff(self.phi_edges)

    def index(self, sin_theta: Array, phi: Array) -> NDArray[np.int64]:
        """Row of the flattened bins [T * P] of each direction."""
        row = np.searchsorted(self.theta_edges, np.arcsin(np.clip(sin_theta, -1, 1)), side="right") - 1
        turned = np.mod(phi - self.phi_edges[0], 2 * np.pi)
        column = (turned * (self.shape[1] / (2 * np.pi))).astype(np.int64)
        return np.clip(row, 0, self.shape[0] - 1) * self.shape[1] + np.clip(column, 0, self.shape[1] - 1)


def direction_bins(theta_bin: float, phi_bin: float) -> DirectionBins:
    """Bins of these sizes [rad], centered at their multiples; they divide a quarter and a half turn."""
    rows, columns = round(np.pi / theta_bin), round(2 * np.pi / phi_bin)
    inner = (np.arange(rows) - rows / 2 + 0.5) * theta_bin
    theta_edges = np.concatenate([[-np.pi / 2], inner, [np.pi / 2]])
    phi_edges = np.asarray((np.arange(columns + 1) - columns / 2 - 0.5) * phi_bin, dtype=np.float64)
    return DirectionBins(theta_edges, phi_edges)


@dataclass(frozen=True)
class ScatteringHistogram:
    """Light of I inclinations, scattered: sums over paths, shape [I, orders, T, P, channels]."""

    theta_i: Array
    """Inclinations of the light, shape [I]; its azimuth is 0."""
    bins: DirectionBins
    weight_sums: Array
    square_sums: Array
    path_counts: NDArray[np.int64]
    """Paths for each inclination, shape [I]."""
    lost_counts: NDArray[np.int64]
    """Paths without a way out in 100,000 meetings with the surface, shape [I]; their light is missing."""
    mean_width: float
    """Projected width of the fiber, averaged over its rotation [mm]; the light that it catches."""

    def phase_function(self, order: str | None = None) -> Array:
        """f_p per steradian, averaged over each bin: [I, T, P, channels]. All orders, or one of `ORDERS`."""
        return self._mean(self.weight_sums, order) / self.bins.solid_angles[..., None]

    def standard_errors(self, order: str | None = None) -> Array:
        """Of `phase_function`; 0 where no path came."""
        mean, square = self._mean(self.weight_sums, order), self._mean(self.square_sums, order)
        return _error_of_mean(mean, square, self.path_counts) / self.bins.solid_angles[..., None]

    def resolution(self) -> Array:
        """f_p that one path of mean weight gives: [I, T, P, channels]. Nothing smaller can be told from 0."""
        total = self.weight_sums.sum(axis=(1, 2, 3)) / self.path_counts[:, None]
        one = total / self.path_counts[:, None]
        return one[:, None, None] / self.bins.solid_angles[..., None]

    def energies(self) -> Array:
        """Part of the light that leaves in each order: [I, orders, channels]."""
        return self.weight_sums.sum(axis=(2, 3)) / self.path_counts[:, None, None]

    def energy_errors(self) -> Array:
        """Standard errors of `energies`."""
        square = self.square_sums.sum(axis=(2, 3)) / self.path_counts[:, None, None]
        return _error_of_mean(self.energies(), square, self.path_counts)

    def albedo(self) -> tuple[Array, Array]:
        """Part of the light that leaves at all, and its standard error: [I, channels] each."""
        mean = self.energies().sum(axis=1)
        square = self.square_sums.sum(axis=(1, 2, 3)) / self.path_counts[:, None]
        return mean, _error_of_mean(mean, square, self.path_counts)

    def _mean(self, sums: Array, order: str | None) -> Array:
        chosen = sums.sum(axis=1) if order is None else sums[:, ORDERS.index(order)]
        return chosen / self.path_counts[:, None, None, None]


def _error_of_mean(mean: Array, square: Array, counts: NDArray[np.int64]) -> Array:
    counts = counts.reshape(-1, *(1,) * (mean.ndim - 1))
    return np.sqrt(np.maximum(square - mean**2, 0.0) / counts)
