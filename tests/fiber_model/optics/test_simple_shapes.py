"""How far simple azimuthal lobes are from the round fiber's, in total variation (half the L1 distance).

The figures of the project's notes, computed there for index 1.55 at normal incidence with the densities
blurred by 5 degrees (TRT also by 15), are met again by other code.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from weft.fiber_model.optics.analytic_cylinder import SmoothCylinder
from weft.fiber_model.scattering.azimuthal import von_mises_eval, wrapped_normal_eval

BINS = 720
EDGES = np.linspace(-np.pi, np.pi, BINS + 1)
MIDDLES = 0.5 * (EDGES[1:] + EDGES[:-1])
WIDTHS = np.radians(np.arange(4, 90, 0.25))
Density = NDArray[np.float64]


@pytest.fixture(scope="module")
def lobes() -> Density:
    """R, TT, TRT around the fiber, each of mass 1."""
    masses = SmoothCylinder(1.55).azimuthal_masses(0.0, EDGES)[:3]
    return masses / masses.sum(axis=1, keepdims=True)


def _blurred(density: Density, degrees: float) -> Density:
    waves = np.fft.rfft(density) * np.exp(-0.5 * (np.arange(BINS // 2 + 1) * np.radians(degrees)) ** 2)
    return np.fft.irfft(waves, BINS)


def _distance(density: Density, simple: Density) -> float:
    return float(0.5 * np.abs(density - simple / simple.sum()).sum())


def _best(density: Density, shape: object, center: float) -> tuple[float, float]:
    """The smallest distance over widths, and that width in degrees."""
    found = [_distance(density, shape(MIDDLES - center, gamma)) for gamma in WIDTHS]  # type: ignore[operator]
    return min(found), float(np.degrees(WIDTHS[np.argmin(found)]))


def test_r_is_nearly_uniform(lobes: Density) -> None:
    assert _distance(_blurred(lobes[0], 5), np.ones(BINS)) == pytest.approx(0.074, abs=0.001)
    assert _distance(lobes[0], np.abs(np.cos(MIDDLES / 2))) == pytest.approx(0.27, abs=0.005)


def test_tt_is_a_lobe_30_degrees_wide(lobes: Density) -> None:
    distance, width = _best(lobes[1], von_mises_eval, np.pi)
    assert distance == pytest.approx(0.017, abs=0.001)
    assert width == pytest.approx(29.75, abs=0.5)
    distance, width = _best(lobes[1], wrapped_normal_eval, np.pi)
    assert distance == pytest.approx(0.0133, abs=0.001)
    assert width == pytest.approx(31.5, abs=0.5)


@pytest.mark.parametrize(("blur", "uniform", "lobe"), [(5, 0.84, 0.16), (15, 0.74, 0.024)])
def test_trt_is_a_backward_lobe(lobes: Density, blur: float, uniform: float, lobe: float) -> None:
    trt = _blurred(lobes[2], blur)
    assert _distance(trt, np.ones(BINS)) == pytest.approx(uniform, abs=0.005)
    assert _best(trt, von_mises_eval, 0.0)[0] == pytest.approx(lobe, abs=0.002)
