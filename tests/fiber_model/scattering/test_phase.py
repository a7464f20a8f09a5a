"""The fiber's phase function: energy, samples, weights, and the kinds it refuses."""

from __future__ import annotations

import itertools
from dataclasses import replace
from math import radians

import numpy as np
import pytest
from scipy import stats

from tests.fiber_model.scattering.scattering_cases import CORNERS, PRESET_NAMES, gray, humps, preset
from tests.fiber_model.scattering.sphere_bins import (
    angles_from_tt,
    cell_integrals,
    direction,
    fiber_bins,
    phi_knots,
    theta_knots,
)
from weft.fiber_model.scattering.azimuthal import (
    von_mises_eval,
    von_mises_sample,
    wrapped_normal_eval,
    wrapped_normal_sample,
)
from weft.fiber_model.scattering.azimuthal_table import table_eval, table_sample
from weft.fiber_model.scattering.parameters import GRAZING
from weft.fiber_model.scattering.phase import (
    azimuthal_widths,
    fiber_phase_albedo,
    fiber_phase_eval,
    fiber_phase_pdf,
    fiber_phase_sample,
    lobe_energies,
    longitudinal_widths,
)
from weft.files.errors import InputError

ALPHA = 1e-4
"""Chance that a correct sampler fails one whole parametrized chi-square test (Bonferroni over its cases)."""


def furnace_error(parameters, theta_o):
    """|∫ f_p dwi - Σ a_k|, by quadrature over the sphere."""
    wo = direction(theta_o, 0.0)
    cells = cell_integrals(
        lambda theta, phi: fiber_phase_eval(parameters, wo, direction(theta, phi + np.pi)),
        theta_knots(parameters, theta_o),
        phi_knots(parameters, theta_o),
    )
    return np.abs(cells.sum(axis=(0, 1)) - fiber_phase_albedo(parameters, wo)).max()


FURNACE = list(
    itertools.product((0.5, 2.0, 10.0, 25.0, 60.0), (2.0, 20.0, 80.0, 300.0), (0.0, 45.0, 80.0, 89.0))
)


@pytest.mark.parametrize(
    ("longitudinal", "azimuthal"), [("gaussian", "wrapped_normal"), ("vmf", "von_mises")]
)
@pytest.mark.parametrize("case", FURNACE[::7])
def test_white_furnace(case, longitudinal, azimuthal):
    beta, gamma, theta_o = case
    white = gray((beta, beta, beta), gamma, longitudinal=longitudinal, azimuthal=azimuthal)
    assert furnace_error(white, radians(theta_o)) < 1e-6


@pytest.mark.parametrize("name", PRESET_NAMES)
def test_presets_return_their_albedo(name):
    for theta_o in (50.0, 88.0):
        assert furnace_error(preset(name), radians(theta_o)) < 1e-6


@pytest.mark.proof
def test_white_furnace_everywhere():
    """|∫ f_p - Σ a_k| <= 1e-6 for 720 configurations."""
    betas, gammas = (0.5, 1.0, 3.0, 10.0, 18.0, 25.0, 40.0, 60.0), (2.0, 10.0, 40.0, 80.0, 101.0, 300.0)
    kinds = [("gaussian", "wrapped_normal"), ("gaussian", "von_mises"), ("vmf", "wrapped_normal")]
    for beta, gamma, theta_o, kind in itertools.product(betas, gammas, (0.0, 30.0, 60.0, 85.0, 89.0), kinds):
        white = gray((beta,) * 3, gamma, longitudinal=kind[0], azimuthal=kind[1])
        assert furnace_error(white, radians(theta_o)) < 1e-6, (beta, gamma, theta_o, kind)


@pytest.mark.parametrize("name", CORNERS)
def test_a_white_fiber_loses_nothing(name):
    wo = direction(np.linspace(-np.pi / 2, np.pi / 2, 101), 0.2)
    np.testing.assert_allclose(fiber_phase_albedo(CORNERS[name], wo), 1, rtol=1e-14)


def test_energy_is_handed_from_lobe_to_lobe():
    """At 60 degrees Schlick's factor is (1 - 1/2)^5 = 1/32, so F = 0.04 + 0.96 / 32 = 0.07."""
    parameters = replace(
        gray(fresnel_r=0.04), color_r=(1.0, 0.5, 0.0), color_tt=(0.2, 0.4, 0.6), color_trt=(0.1, 0.0, 1.0)
    )
    expected = [
        [0.07, 0.035, 0.0],
        [0.93 * 0.7 * color for color in (0.2, 0.4, 0.6)],
        [0.93 * 0.3 * color for color in (0.1, 0.0, 1.0)],
    ]
    np.testing.assert_allclose(lobe_energies(parameters, direction(radians(60), 1.0)), expected, atol=1e-12)


CHI_SQUARE = list(itertools.product(CORNERS, (50.0, 89.0)))


def chi_square_of_samples(parameters, theta_o, sample_count):
    bins = fiber_bins(parameters, theta_o)
    assert bins.total == pytest.approx(1, abs=5e-5 if parameters.longitudinal == "symmetric" else 1e-6)
    u = np.random.default_rng(11).random((sample_count, 4))
    wi, _, _ = fiber_phase_sample(parameters, np.broadcast_to(direction(theta_o, 0.0), (sample_count, 3)), u)
    return bins.p_value(*angles_from_tt(wi))


@pytest.mark.parametrize("case", CHI_SQUARE)
def test_samples_follow_the_pdf(case):
    name, theta_o = case
    assert chi_square_of_samples(CORNERS[name], radians(theta_o), 50_000) > ALPHA / len(CHI_SQUARE)


@pytest.mark.proof
@pytest.mark.parametrize("case", CHI_SQUARE)
def test_a_million_samples_follow_the_pdf(case):
    name, theta_o = case
    assert chi_square_of_samples(CORNERS[name], radians(theta_o), 1_000_000) > ALPHA / len(CHI_SQUARE)


@pytest.mark.parametrize("name", CORNERS)
def test_gray_weight_is_the_albedo_for_every_sample(name):
    rng = np.random.default_rng(3)
    wo = rng.normal(size=(4000, 3))
    wo /= np.linalg.norm(wo, axis=1, keepdims=True)
    dim = replace(CORNERS[name], color_r=(0.3,) * 3, color_tt=(0.9,) * 3, color_trt=(0.5,) * 3)
    _, weight, pdf = fiber_phase_sample(dim, wo, rng.random((4000, 4)))
    np.testing.assert_allclose(weight, fiber_phase_albedo(dim, wo), rtol=1e-12)
    assert np.all(pdf > 0)


@pytest.mark.parametrize("name", PRESET_NAMES)
def test_weight_is_eval_over_pdf_and_averages_to_the_albedo(name):
    """Bounded weights; their mean within 5 standard errors (chance below 1e-5 over all presets)."""
    parameters, rng = preset(name), np.random.default_rng(4)
    wo = direction(radians(35), 0.4)
    wi, weight, pdf = fiber_phase_sample(
        parameters, np.broadcast_to(wo, (50_000, 3)), rng.random((50_000, 4))
    )
    np.testing.assert_allclose(weight, fiber_phase_eval(parameters, wo, wi) / pdf[:, None], rtol=1e-9)
    np.testing.assert_allclose(pdf, fiber_phase_pdf(parameters, wo, wi), rtol=1e-9)
    albedo = fiber_phase_albedo(parameters, wo)
    error = weight.std(axis=0) / np.sqrt(len(weight))
    assert np.all(np.abs(weight.mean(axis=0) - albedo) < 5 * error + 1e-10)  # one lobe: no error but rounding
    assert weight.max() < 2


def test_grazing_values_equal_to_the_normal_ones_change_nothing():
    plain = CORNERS["narrow"]
    same = replace(plain, **{name: plain.at_grazing(name.removesuffix("_grazing")) for name in GRAZING})
    rng = np.random.default_rng(5)
    wo, wi = rng.normal(size=(2, 1000, 3))
    np.testing.assert_allclose(fiber_phase_eval(same, wo, wi), fiber_phase_eval(plain, wo, wi), rtol=1e-12)


def test_widths_and_t_go_linearly_with_one_minus_the_cosine():
    """Half way, at 60 degrees, they are the mean of both; at the ends they are the values themselves."""
    medium = CORNERS["grazing"]
    for theta_o, share in ((0.0, 0.0), (60.0, 0.5), (-90.0, 1.0)):
        beta = longitudinal_widths(medium, np.radians(theta_o))[1]
        gamma = azimuthal_widths(medium, np.radians(theta_o))[1]
        np.testing.assert_allclose(np.degrees([beta, gamma]), [4 + 5 * share, 30 + 45 * share], atol=1e-9)
        t_over_rest = lobe_energies(medium, direction(np.radians(theta_o), 0.3))[1:3, 0]
        t = t_over_rest[0] / max(t_over_rest.sum(), 1e-300)
        assert share == 1.0 or t == pytest.approx(0.7 - 0.4 * share, abs=1e-12)


def test_turning_the_fiber_around_itself_changes_nothing():
    parameters = preset("khungurn2015_fleece")
    wo, wi = direction(0.3, 0.1), direction(-0.4, 2.9)
    turned = fiber_phase_eval(parameters, direction(0.3, 1.1), direction(-0.4, 3.9))
    mirrored = fiber_phase_eval(parameters, -wo, -wi)
    np.testing.assert_allclose(fiber_phase_eval(parameters, wo, wi), turned, rtol=1e-12)
    np.testing.assert_allclose(fiber_phase_eval(parameters, wo, wi), mirrored, rtol=1e-12)


def test_light_along_the_fiber_is_finite():
    wo, u = np.array([[1.0, 0, 0], [-1.0, 0, 0]]), np.array([[0.999, 0.5, 0.5, 0.5]] * 2)
    wi, weight, _ = fiber_phase_sample(CORNERS["narrow"], wo, u)
    assert np.all(np.isfinite(wi))
    np.testing.assert_allclose(weight, 1)


def test_a_black_fiber_scatters_nothing():
    black = replace(gray(), color_r=(0.0,) * 3, color_tt=(0.0,) * 3, color_trt=(0.0,) * 3)
    _, weight, pdf = fiber_phase_sample(black, direction(0.2, 0.0), np.array([0.5, 0.5, 0.5, 0.5]))
    assert np.all(weight == 0)
    assert pdf > 0


@pytest.mark.parametrize("gamma", [radians(gamma) for gamma in (2, 20, 70, 100, 102, 300)])
def test_azimuthal_samples_have_the_lobes_mean_resultant(gamma):
    """Circular means against quadrature of the density; each fails by chance below 1e-6."""
    phi = np.linspace(-np.pi, np.pi, 40_001)[:-1]
    u = np.random.default_rng(9).random(40_000)
    for density, sample in (
        (wrapped_normal_eval(phi, gamma), wrapped_normal_sample(gamma, u)),
        (von_mises_eval(phi, gamma), von_mises_sample(gamma, u)),
    ):
        assert density.mean() * 2 * np.pi == pytest.approx(1, abs=1e-12)
        for wave in (1, 2):
            mean = (density * np.cos(wave * phi)).mean() * 2 * np.pi
            error = np.cos(wave * sample).std() / 200
            assert abs(np.cos(wave * sample).mean() - mean) < 5 * error
    assert wrapped_normal_eval(0.3, gamma) == pytest.approx(wrapped_normal_eval(0.3 - 2 * np.pi, gamma))


def test_a_table_of_a_simple_lobe_is_that_lobe():
    """129 knots of a wrapped normal, wide enough for straight pieces: to the square of the step, 3e-4."""
    gamma, angle = radians(40), np.linspace(0, np.pi, 129)
    rows = tuple(tuple(map(float, 7 * wrapped_normal_eval(angle, width))) for width in (gamma, 2 * gamma))
    phi = np.linspace(-9, 9, 1001)
    for cos_o, share in ((1.0, 0.0), (0.75, 0.25), (0.0, 1.0)):
        mixed = sum(
            part * wrapped_normal_eval(phi, width) for part, width in ((1 - share, gamma), (share, 2 * gamma))
        )
        np.testing.assert_allclose(table_eval(phi, rows, cos_o), mixed, atol=1e-4)


@pytest.mark.parametrize("rows", [1, 2, 4])
def test_samples_of_a_table_follow_it(rows):
    """Kolmogorov-Smirnov of 50,000 angles at three inclinations against the integral of the density."""
    table = humps(rows, 33, seed=rows)
    for cos_o in (1.0, 0.6, 0.05):
        sample = table_sample(table, cos_o, np.random.default_rng(3).random(50_000))
        phi = np.linspace(-np.pi, np.pi, 64 * 32 + 1)
        density = table_eval(phi, table, cos_o)
        mass = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(phi))])
        assert mass[-1] == pytest.approx(1, abs=1e-12)
        # quadratic between knots, so linear interpolation on this grid is good to 1e-4, 2 % of the limit
        assert stats.kstest(sample, lambda x, p=phi, m=mass: np.interp(x, p, m)).pvalue > ALPHA


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"longitudinal": "lambert"}, "longitudinal kind 'lambert' is unknown"),
        ({"azimuthal": "cauchy"}, "azimuthal kind 'cauchy' is unknown"),
        ({"longitudinal_width_tt": float("nan")}, "must lie in"),
        ({"azimuthal_width_tt": 0.0}, "must lie in"),
        ({"color_tt": (0.5, 1.5, 0.5)}, "color_tt is 1.5"),
        ({"fresnel_tt": float("nan")}, "fresnel_tt is nan"),
        ({"azimuthal_width_trt_grazing": 1.0}, "needs azimuthal_width_trt"),
        ({"longitudinal_width_trt_grazing": 0.1}, "between half the width at normal incidence"),
        ({"fresnel_tt_grazing": 0.2, "longitudinal": "symmetric"}, "is not reciprocal"),
        ({"azimuthal_table_tt": humps(2, 33, seed=1), "longitudinal": "symmetric"}, "is not reciprocal"),
        ({"azimuthal_table_tt": ((1.0,) * 8,)}, "rows of 8 numbers; all must have the same number, 9 to 129"),
        ({"azimuthal_table_tt": ((1.0,) * 9, (1.0,) * 10)}, "rows of 9, 10 numbers"),
        ({"azimuthal_table_r": ((1.0,) * 9,) * 5}, "has 5 rows; it must have 1 to 4"),
        ({"azimuthal_table_trt": ((0.0,) * 9,)}, "one above 0 in each row"),
        ({"azimuthal_table_trt": ((1.0,) * 8 + (-1.0,),)}, "densities of at least 0"),
        ({"azimuthal_table_trt": ((1.0,) * 8 + (float("inf"),),)}, "finite densities"),
        (
            {"azimuthal_table_r": humps(1, 9, seed=1), "azimuthal_table_tt": humps(2, 9, seed=1)},
            "must have one shape",
        ),
        ({"tail_weight_r": 0.5}, "tail_weight_r needs tail_ratio_r"),
        ({"tail_weight_tt_grazing": 0.5, "tail_ratio_tt": 1.0}, "needs tail_weight_tt"),
        ({"tail_weight_r": 1.5, "tail_ratio_r": 1.0}, "tail_weight_r is 1.5"),
        ({"tail_weight_r": 0.5, "tail_ratio_r": 4.5}, r"must lie in \[0.25, 4\]"),
        (
            {"tail_weight_r": 0.5, "tail_ratio_r": 0.3, "longitudinal_width_r": radians(1.0)},
            "tail of 0.3 deg",
        ),
        ({"tail_weight_r": 0.5, "tail_ratio_r": 1.0, "longitudinal": "symmetric"}, "cannot go with"),
    ],
)
def test_refuses_with_one_clear_line(changes, message):
    with pytest.raises(InputError, match=message):
        replace(gray(), **changes)
