"""Zhao, Luan and Bala 2016, equations 1, 9, 10."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import integrate

from weft.fiber_model.cross_section import cross_section_density, radius_cdf, sample_cross_section

ALL = (
    *("cotton1", "cotton2", "polyester1", "rayon1", "rayon2", "rayon3", "rayon4", "silk1", "silk2"),
    *("wool1", "linen1"),
)
"""Every preset: nine fitted yarns and two estimated ones."""
COUNT = 100_000


def _cdf_by_quadrature(radius: float, epsilon: float, beta: float) -> float:
    """Written out again from equations 1 and 9, with an adaptive rule."""

    def mass(r: float) -> float:
        return 2 * r * ((1 - 2 * epsilon) * ((np.e - np.e**r) / (np.e - 1)) ** beta + epsilon)

    return integrate.quad(mass, 0, radius)[0] / integrate.quad(mass, 0, 1)[0]


@pytest.mark.parametrize("preset", ALL)
def test_sampled_radii_follow_the_density(preset: str, fiber_config) -> None:
    config = fiber_config(preset)
    shape = {"epsilon": config.cross_section_epsilon, "beta": config.cross_section_beta}
    fiber = np.arange(COUNT)
    radius, angle = sample_cross_section(1, fiber // 200, fiber % 200, **shape)
    sorted_radius = np.sort(radius)
    cdf = radius_cdf(sorted_radius, **shape)
    distance = max(np.abs(cdf - fiber / COUNT).max(), np.abs(cdf - (fiber + 1) / COUNT).max())
    assert distance < 0.01
    assert np.abs(np.sort(angle) / (2 * np.pi) - (fiber + 0.5) / COUNT).max() < 0.01
    assert radius.min() > 0
    assert radius.max() < 1


@pytest.mark.parametrize(("epsilon", "beta"), [(0.0, 0.2), (0.4, 0.6), (0.14, 0.69)])
def test_cdf_is_the_integral_of_the_density(epsilon: float, beta: float) -> None:
    for radius in (0.1, 0.5, 0.9, 0.999):
        expected = _cdf_by_quadrature(radius, epsilon, beta)
        assert radius_cdf(np.array([radius]), epsilon=epsilon, beta=beta)[0] == pytest.approx(
            expected, abs=1e-6
        )


def test_density_at_center_and_border() -> None:
    center, border = cross_section_density(np.array([0.0, 1.0]), epsilon=0.1, beta=0.5)
    assert (center, border) == pytest.approx((0.9, 0.1))
