"""Bins of direction cover the sphere once, and sums over paths become densities with errors."""

from __future__ import annotations

import numpy as np
import pytest

from weft.fiber_model.optics.histogram import ORDERS, ScatteringHistogram, direction_bins


@pytest.mark.parametrize(("theta_deg", "phi_deg"), [(5, 10), (2.5, 10), (7.5, 45), (1, 1)])
def test_bins_cover_the_sphere_once(theta_deg: float, phi_deg: float) -> None:
    bins = direction_bins(np.radians(theta_deg), np.radians(phi_deg))
    assert bins.solid_angles.sum() == pytest.approx(4 * np.pi, rel=1e-12)
    assert bins.theta_edges[[0, -1]] == pytest.approx([-np.pi / 2, np.pi / 2])
    assert np.ptp(bins.phi_edges) == pytest.approx(2 * np.pi)
    # the cone of light at any multiple of the bin's size, and the light itself, lie in the middle of a bin
    assert np.abs(bins.theta - np.radians(3 * theta_deg)).min() < 1e-12
    assert np.abs(bins.phi).min() < 1e-12


def test_every_direction_is_counted_in_the_bin_around_it() -> None:
    bins = direction_bins(np.radians(5), np.radians(10))
    inside = np.array([0.01, 0.5, 0.99])
    theta = bins.theta_edges[:-1, None] + np.diff(bins.theta_edges)[:, None] * inside
    phi = bins.phi_edges[:-1, None] + np.diff(bins.phi_edges)[:, None] * inside
    every = np.arange(bins.shape[0] * bins.shape[1]).reshape(bins.shape)
    for turns in (-1, 0, 1):
        index = bins.index(np.sin(theta)[:, None, :, None], phi[None, :, None, :] + 2 * np.pi * turns)
        assert np.array_equal(index, np.broadcast_to(every[:, :, None, None], index.shape))


def test_errors_are_those_of_the_mean() -> None:
    """Against numpy, for weights of 1000 paths of which some come to the bin."""
    weights = np.where(np.arange(1000) % 7 == 0, np.linspace(0.5, 1.5, 1000), 0.0)
    bins = direction_bins(np.radians(30), np.radians(90))
    sums = np.zeros((1, len(ORDERS), *bins.shape, 1))
    squares = np.zeros_like(sums)
    sums[0, 1, 2, 3, 0], squares[0, 1, 2, 3, 0] = weights.sum(), (weights**2).sum()
    count = np.array([1000])
    result = ScatteringHistogram(np.zeros(1), bins, sums, squares, count, np.zeros(1, dtype=np.int64), 1.0)
    solid = bins.solid_angles[2, 3]
    assert result.phase_function("TT")[0, 2, 3, 0] == pytest.approx(weights.mean() / solid)
    assert result.standard_errors()[0, 2, 3, 0] == pytest.approx(weights.std() / np.sqrt(1000) / solid)
    assert result.albedo()[1][0, 0] == pytest.approx(weights.std() / np.sqrt(1000))
    assert result.energy_errors()[0, 1, 0] == pytest.approx(weights.std() / np.sqrt(1000))
    assert result.resolution()[0, 2, 3, 0] == pytest.approx(weights.mean() / 1000 / solid)
    assert not result.phase_function("R").any()
