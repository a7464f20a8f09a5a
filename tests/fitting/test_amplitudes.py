"""Variable projection: the amplitudes are those of least squares, weighted once, and none is negative."""

from __future__ import annotations

import numpy as np

from tests.fitting.fit_cases import problem, random_truth, synthetic, vector_of
from weft.fitting.amplitudes import amplitude_choice, lobe_columns, solve_amplitudes

TRUTH = random_truth(np.random.default_rng(1))


def projected(measurements, full):
    residual, parameterization, data = problem(measurements)
    columns = lobe_columns(residual.kinds, residual.channels, full, data)
    choice = amplitude_choice(parameterization, residual.channels)
    return np.asarray(columns), np.asarray(solve_amplitudes(columns, data, choice)), choice, data


def test_exact_values_give_the_energies_back():
    """C_R F_R, C_R, C_TT T (1 - F_R) and C_TRT (1 - T) (1 - F_R) of the README, with the scale one."""
    _, (found,), _, _ = projected(synthetic(TRUTH, noise=0.0), vector_of(TRUTH))
    f, t = TRUTH.fresnel_r[0], TRUTH.fresnel_tt
    entering = 1 - f
    expected = [f, 1.0, TRUTH.color_tt[0] * t * entering, TRUTH.color_trt[0] * (1 - t) * entering]
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_what_is_left_is_orthogonal_to_what_is_free():
    """The normal equations with weights 1 / sigma, at wrong widths too: that is the minimum."""
    wrong = vector_of(TRUTH)
    wrong[:5] *= [1.3, 0.8, 1.2, 1.1, 0.9]
    columns, amplitudes, choice, data = projected(synthetic(TRUTH, seed=1), wrong)
    weights = np.asarray(data.weights)
    left = weights * (columns @ amplitudes.T - np.asarray(data.values))
    weighted = weights * columns
    size = np.linalg.norm(weighted, axis=0) * np.linalg.norm(left)
    assert (amplitudes >= 0).all()
    positive = (amplitudes[0] > 1e-6) & (choice.free > 0)
    assert positive.sum() == 3
    assert np.abs((weighted * left).sum(axis=0) / size)[positive].max() < 1e-7


def test_no_amplitude_is_negative():
    """TT taken out of the values twice: least squares alone would have it below zero."""
    measured = synthetic(TRUTH, noise=0.0)
    columns, (found,), _, data = projected(measured, vector_of(TRUTH))
    less = np.asarray(data.values)[:, 0] - 2 * found[2] * columns[:, 2]
    residual, parameterization, _ = problem(measured)
    choice = amplitude_choice(parameterization, residual.channels)
    again = np.asarray(solve_amplitudes(columns, data._replace(values=less[:, None]), choice))[0]
    assert (again >= 0).all()
    assert again[2] == 0
