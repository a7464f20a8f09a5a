"""The series of the smooth round fiber: energies, azimuths, limits."""

from __future__ import annotations

import numpy as np
import pytest

from weft.fiber_model.optics.analytic_cylinder import SmoothCylinder
from weft.fiber_model.optics.dielectric import fresnel

FIBER = SmoothCylinder(1.55)


@pytest.mark.parametrize(
    ("theta_deg", "expected"),
    [
        (0, (0.075, 0.862, 0.056, 0.008)),
        (45, (0.110, 0.803, 0.074, 0.014)),
        (75, (0.360, 0.425, 0.137, 0.078)),
    ],
)
def test_energies_are_those_computed_elsewhere(theta_deg: float, expected: tuple[float, ...]) -> None:
    assert FIBER.energies(np.radians(theta_deg)) == pytest.approx(expected, abs=6e-4)


@pytest.mark.parametrize("theta_deg", [0, 30, 60, 85])
def test_without_absorption_no_energy_is_lost(theta_deg: float) -> None:
    assert FIBER.energies(np.radians(theta_deg)).sum() == pytest.approx(1, abs=1e-6)


def test_azimuthal_masses_add_up_to_the_energies() -> None:
    edges = np.linspace(-np.pi, np.pi, 73)
    masses = SmoothCylinder(1.55, 0.3).azimuthal_masses(0.5, edges, offsets=20_000)
    assert masses.sum(axis=1) == pytest.approx(SmoothCylinder(1.55, 0.3).energies(0.5), rel=1e-5)
    assert masses == pytest.approx(masses[:, ::-1], abs=1e-4)


def test_a_thin_index_lets_all_light_straight_through() -> None:
    energies = SmoothCylinder(1.0001).energies(0.3)
    assert energies[1] == pytest.approx(1, abs=1e-4)
    assert SmoothCylinder(1.0001, 0.2).energies(0.0)[1] == pytest.approx(_slab_of_chords(0.2), abs=2e-4)


def _slab_of_chords(absorption: float) -> float:
    """Mean of exp(-absorption * chord) over chords 2 sqrt(1 - h²) of the unit circle."""
    h = (np.arange(20_000) + 0.5) / 10_000 - 1
    return float(np.exp(-2 * absorption * np.sqrt(1 - h**2)).mean())


def test_fresnel_at_known_angles() -> None:
    assert fresnel(1.0, 1.5) == pytest.approx(0.04)
    assert fresnel(0.0, 1.5) == 1
    brewster = np.cos(np.arctan(1.5))
    across = ((1 - 1.5**2) / (1 + 1.5**2)) ** 2
    assert fresnel(brewster, 1.5) == pytest.approx(0.5 * across)
    assert fresnel(np.cos(0.8), 1 / 1.5) == 1  # total reflection beyond 41.8 degrees
    inside = np.sqrt(1 - (np.sin(0.6) / 1.5) ** 2)
    assert fresnel(np.cos(0.6), 1.5) == pytest.approx(fresnel(inside, 1 / 1.5))
