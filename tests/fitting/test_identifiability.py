"""Every exact degeneracy is named, with the tie that resolves it; and ties resolve them."""

from __future__ import annotations

import numpy as np
import pytest

from tests.fitting.fit_cases import config, random_truth, synthetic
from weft.fitting.fit import run
from weft.fitting.selection import take

TRUTH = random_truth(np.random.default_rng(1))


def names(result):
    return {degeneracy.name for degeneracy in result.degeneracies}


@pytest.fixture(scope="module")
def measured():
    return synthetic(TRUTH, seed=1)


def test_default_ties_leave_nothing_undetermined(measured):
    assert not run(config(), measured).degeneracies


def test_transmitted_energy_is_named(measured):
    result = run(config(parameters={"color_trt": {}}), measured)
    (found,) = result.degeneracies
    assert found.name == "C_TT * F_TT and C_TRT * (1 - F_TT)"
    assert found.exact
    assert set(found.parameters) == {"fresnel_tt", "color_tt", "color_trt"}
    errors = {number.name: number.standard_error for number in result.fitted}
    assert errors["fresnel_tt"] is None
    assert errors["longitudinal_width_r_deg"] is not None


@pytest.mark.parametrize(
    "remedy", [{"brightest_tt": True}, {"parameters": {"color_trt": {}, "fresnel_tt": {"fixed": 0.6}}}]
)
def test_each_remedy_resolves_it(measured, remedy):
    assert not run(config(**remedy), measured).degeneracies


def test_one_angle_is_named(measured):
    one = take(measured, np.degrees(measured.theta_i).round() == 30)
    assert "C_R * F_R at one angle" in names(run(config(parameters={"color_r": {}}), one))


def test_in_plane_data_are_named():
    """Narrow around the fiber, so that the plane sees the center of TT's lobe alone."""
    from dataclasses import replace

    narrow = replace(TRUTH, azimuthal_width_tt=np.radians(26.0))
    data = synthetic(narrow, seed=1)
    plane = take(data, np.abs(np.sin(data.phi_o)) < 1e-6)
    assert "gamma_TT from in-plane data alone" in names(run(config(), plane))


def test_free_scale_against_colors_is_named(measured):
    free = {"scale": {}, "color_r": {}}
    assert "scale * C_R, scale * C_TT and scale * C_TRT" in names(
        run(config(parameters={**free, "color_trt": {}, "fresnel_tt": {"fixed": 0.6}}), measured)
    )
