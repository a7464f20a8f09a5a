"""The stage as a whole: what it finds, what it says of it, and what it refuses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.fitting.fit_cases import config, random_truth, synthetic, vector_of
from weft.fiber_model.scattering.parameters import GRAZING
from weft.files.errors import InputError
from weft.fitting.fit import run
from weft.fitting.parameterization import to_external_units

TRUTH = random_truth(np.random.default_rng(1))


@pytest.fixture(scope="module")
def fitted():
    return run(config(), synthetic(TRUTH, seed=1, state_sigma=False))


def test_truth_lies_within_four_standard_errors(fitted):
    """A correct fit fails with probability 7e-4 (eleven numbers of 6e-5)."""
    truth = to_external_units(vector_of(TRUTH))
    for number, expected in zip(fitted.fitted, truth, strict=True):
        assert number.standard_error is not None
        assert abs(number.value - expected) <= 4 * number.standard_error + 1e-12, number.name


def test_chi_square_is_about_one_per_degree_of_freedom(fitted):
    """Within five standard deviations of chi²; a correct fit fails with probability 6e-7."""
    n = fitted.degrees_of_freedom
    assert abs(fitted.chi2 / n - 1) < 5 * np.sqrt(2 / n)


def test_repeats_itself_to_the_bit(fitted):
    again = run(config(), synthetic(TRUTH, seed=1, state_sigma=False))
    assert again.fitted == fitted.fitted
    assert again.chi2 == fitted.chi2


def test_noise_free_values_give_the_parameters_back():
    exact = run(config(noise={"kind": "uniform"}), synthetic(TRUTH, noise=0.0))
    truth = to_external_units(vector_of(TRUTH))
    np.testing.assert_allclose([number.value for number in exact.fitted], truth, rtol=1e-6)


@pytest.mark.proof
def test_held_tails_come_through_and_the_rest_is_found():
    """Values of a fiber with tails, fitted with these held; without them the widths come out wrong."""
    held = {"tail_weight_r": 0.5, "tail_ratio_r": 1.5, "tail_weight_tt": 0.3, "tail_ratio_tt": 2.0}
    held["tail_weight_tt_grazing"] = 0.6
    truth, numbers = replace(TRUTH, **held), to_external_units(vector_of(TRUTH))
    exact = synthetic(truth, noise=0.0)
    fitted = run(config(noise={"kind": "uniform"}, **held), exact)
    np.testing.assert_allclose([number.value for number in fitted.fitted], numbers, rtol=1e-6)
    assert all(getattr(fitted.parameters, name) == value for name, value in held.items())
    bare = run(config(noise={"kind": "uniform"}), exact)
    assert abs(bare.fitted[1].value / numbers[1] - 1) > 0.05


@pytest.mark.parametrize("kind", ["profile", "bootstrap"])
def test_intervals_agree_with_the_covariance_where_the_data_are_good(kind, fitted):
    """Bootstrap bounds of 200 samples scatter by about a tenth of their distance (68 %) from the value."""
    other = run(config(intervals=kind), synthetic(TRUTH, seed=1, state_sigma=False))
    for number, standard in zip(other.fitted, fitted.fitted, strict=True):
        if standard.intervals is None:
            assert number.intervals is None
            continue
        for (low, high), (low0, high0) in zip(number.intervals, standard.intervals, strict=True):
            assert high - low == pytest.approx(high0 - low0, rel=0.05 if kind == "profile" else 0.35)
            assert low < standard.value < high


@pytest.fixture(scope="module")
def in_part():
    """A fit of some of its data."""
    mask = [{"theta_o_deg": [-90, 0], "phi_deg": [90, 180]}]
    return run(config(held_out_theta_i_deg=[60.0], mask=mask), synthetic(TRUTH, seed=2))


def test_held_out_angle_is_not_seen_and_its_error_told(in_part):
    assert 60.0 not in np.round(np.degrees(in_part.seen.theta_i), 6)
    (held_out,) = in_part.held_out
    assert held_out.theta_i_deg == 60.0
    assert 0.8 < held_out.chi2_per_value < 1.3


def test_mask_leaves_directions_out(in_part):
    theta, phi = np.degrees(in_part.seen.theta_o), np.degrees(in_part.seen.phi_o)
    assert not ((theta <= 0) & (phi >= 90)).any()
    assert (phi >= 90).any()
    assert (theta <= 0).any()


@pytest.mark.parametrize("robust", ["huber", "cauchy"])
def test_robust_loss_holds_back_outliers(robust):
    """One value in fifty is tripled; the plain fit must be led astray for the test to mean something."""
    clean = synthetic(TRUTH, seed=3)
    values = clean.values.copy()
    values[::50] *= 3
    spoiled = replace(clean, values=values)
    truth = to_external_units(vector_of(TRUTH))[:7]
    errors = {
        kind: max(
            abs(number.value / expected - 1)
            for number, expected in zip(run(config(robust=kind), spoiled).fitted[:7], truth, strict=True)
        )
        for kind in ("none", robust)
    }
    assert errors["none"] > 0.04
    assert errors[robust] < 0.02


def test_too_few_values_are_refused():
    from weft.fitting.selection import take

    data = synthetic(TRUTH)
    with pytest.raises(InputError, match="cannot determine"):
        run(config(), take(data, np.arange(len(data)) < 5))


def test_surface_measurements_are_refused():
    with pytest.raises(InputError, match="of a surface"):
        run(config(), replace(synthetic(TRUTH), quantity="brdf"))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"grazing": True, "longitudinal": "symmetric"}, "not reciprocal"),
        ({"grazing": True, "brightest_tt": True}, "no freedom"),
        ({"parameters": {"fresnel_tt_grazing": {"fixed": 0.5}}}, "needs grazing = true"),
    ],
)
def test_refuses_what_cannot_be_fitted(changes, message):
    with pytest.raises(ValueError, match=message):
        config(**changes)


@pytest.mark.proof
def test_reciprocal_lobes_are_fitted_too():
    exact = synthetic(replace(TRUTH, longitudinal="symmetric"), noise=0.0)
    found = run(config(longitudinal="symmetric", noise={"kind": "uniform"}), exact)
    truth = to_external_units(vector_of(TRUTH))
    np.testing.assert_allclose([number.value for number in found.fitted], truth, rtol=1e-5)
    assert found.parameters.longitudinal == "symmetric"


@pytest.mark.proof
@pytest.mark.parametrize("seed", range(5))
def test_what_changes_with_the_angle_is_found(seed):
    """Within four and a half standard errors, all of 17 numbers; a correct fit fails one seed with 1.2e-4."""
    rng, still = np.random.default_rng(seed), random_truth(np.random.default_rng(seed))
    growth = dict(zip(GRAZING, [*rng.uniform(0.8, 1.8, 5), rng.uniform(0.3, 1.0)], strict=True))
    most = [np.radians(45.0)] * 3 + [np.radians(300.0)] * 2 + [1.0]
    along_fiber = {
        name: min(factor * getattr(still, name.removesuffix("_grazing")), high)
        for (name, factor), high in zip(growth.items(), most, strict=True)
    }
    truth = replace(still, **along_fiber)
    found = run(config(grazing=True), synthetic(truth, seed=seed))
    expected = to_external_units(np.concatenate([vector_of(still), list(along_fiber.values())]))
    for number, value in zip(found.fitted, expected, strict=True):
        if number.role == "free" and not number.at_bound:
            assert abs(number.value - value) <= 4.5 * number.standard_error, number.name
