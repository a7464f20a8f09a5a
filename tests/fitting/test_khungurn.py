"""Khungurn's five fabrics: evaluated, noised, refitted."""

from __future__ import annotations

import numpy as np
import pytest

from tests.fiber_model.scattering.scattering_cases import preset
from tests.fitting.fit_cases import config, synthetic, vector_of
from weft.fitting.fit import run
from weft.fitting.parameterization import to_external_units

FABRICS = ("fleece", "gabardine", "silk", "cotton", "polyester")
TWO_LOBES = {
    "gamma_trt": False,
    "parameters": {"color_r": {"fixed": 1.0}, "fresnel_tt": {"fixed": 1.0}, "color_trt": {"fixed": 1.0}},
}
"""F_R per channel is their C_R; C_R := 1 and T := 1, so there is no TRT."""


def deviations(fabric: str, seed: int) -> dict[str, float]:
    """(fitted - published) / standard error of each free number that ends away from its bounds."""
    published = preset(f"khungurn2015_{fabric}")
    result = run(config(**TWO_LOBES), synthetic(published, seed=seed, channels=3))
    truth = to_external_units(vector_of(published, 3))
    found = {}
    for number, expected in zip(result.fitted, truth, strict=True):
        if number.role != "free" or number.standard_error is None:
            continue
        if number.at_bound:
            # the noise of the data decides on which side of so near a bound the minimum would lie
            assert abs(number.value - expected) <= 0.02, number
        else:
            found[number.name] = (number.value - expected) / number.standard_error
    return found


@pytest.mark.proof
def test_published_parameters_are_found_again(capsys):
    """Of so many numbers one in twenty lies beyond two standard errors by chance alone.

    A correct fit has more than one in eight there, or one beyond four, with probability below 2 %.
    """
    every = {fabric: deviations(fabric, seed) for seed, fabric in enumerate(FABRICS)}
    flat = np.array([value for found in every.values() for value in found.values()])
    with capsys.disabled():
        for fabric, found in every.items():
            listed = ", ".join(f"{name} {value:+.2f}" for name, value in found.items())
            print(f"\n{fabric}: {len(found)} of 9 free of bounds: {listed}")
        print(f"within 2 sigma: {(np.abs(flat) <= 2).sum()} of {flat.size}; largest {np.abs(flat).max():.2f}")
    assert (np.abs(flat) > 2).mean() <= 1 / 8
    assert np.abs(flat).max() < 4
