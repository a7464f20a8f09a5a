"""Files of fitted scattering parameters: read as written, damage is named, nothing is half written."""

from __future__ import annotations

import json
from dataclasses import asdict, replace

import numpy as np
import pytest

from tests.fiber_model.scattering.scattering_cases import CORNERS, gray
from weft.fiber_model.scattering.config import LobesConfig
from weft.fiber_model.scattering.parameter_file import (
    ParameterCovariance,
    ScatteringParameterFile,
    load_parameters,
    save_parameters,
    scalar_names,
)
from weft.files.errors import InputError

PROVENANCE = {"source": "a synthetic cylinder", "method": "least squares", "seeds": [1, 2]}


def content(**changes):
    made = ScatteringParameterFile(
        LobesConfig.from_parameters(gray(gamma_trt_deg=33.3)),
        PROVENANCE,
        {"longitudinal_width_r_deg": 0.1, "color_tt.g": 0.02},
        ParameterCovariance(("fresnel_tt", "color_tt.g"), np.array([[4e-4, 1e-4], [1e-4, 9e-4]])),
    )
    return replace(made, **changes)


def test_what_is_saved_is_loaded_exactly(tmp_path):
    save_parameters(tmp_path / "fit.json", content())
    found = load_parameters(tmp_path / "fit.json")
    assert found.lobes == content().lobes
    assert found.provenance == PROVENANCE
    assert found.standard_errors == content().standard_errors
    assert found.covariance.names == content().covariance.names
    np.testing.assert_array_equal(found.covariance.matrix, content().covariance.matrix)
    save_parameters(tmp_path / "again.json", found)
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "fit.json").read_bytes()


@pytest.mark.parametrize("name", CORNERS)
def test_parameters_survive_the_way_through_degrees(name, tmp_path):
    lobes = LobesConfig.from_parameters(CORNERS[name])
    save_parameters(tmp_path / "fit.json", ScatteringParameterFile(lobes, PROVENANCE))
    found = asdict(load_parameters(tmp_path / "fit.json").parameters)
    for key, value in asdict(CORNERS[name]).items():
        if isinstance(value, str) or value is None:
            assert found[key] == value
        else:
            np.testing.assert_allclose(found[key], value, rtol=4e-16)


def test_names_of_single_numbers():
    names = scalar_names()
    assert len(names) == 2 * (5 + 1) + 4 * 3 + 3 * 3
    assert {"azimuthal_width_trt_deg", "fresnel_tt", "fresnel_r.b", "color_trt.r"} <= set(names)


def damaged(document, path, value):
    *parents, last = path
    for key in parents:
        document = document[key]
    document[last] = value


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (["format"], "something else", "holds no fitted scattering parameters"),
        (["format_version"], 9, "has format version 9; this weft reads 1"),
        (["scattering"], [], "scattering: must be an object"),
        (["scattering", "fit"], "me.json", "scattering: must be an object"),
        (["scattering", "fresnel_tt"], 1.5, r"scattering.fresnel_tt: input should be less than"),
        (["scattering", "fresnel_tt"], None, r"scattering.fresnel_tt: input should be a valid number"),
        (["scattering", "beta"], 1.5, r"scattering.beta: extra inputs"),
        (["provenance"], None, "provenance.source: must say"),
        (["provenance", "method"], " ", "provenance.method: must say"),
        (["standard_errors"], 3, "must be an object of numbers"),
        (["standard_errors", "beta"], 3, "'beta' is no parameter"),
        (["standard_errors", "fresnel_tt"], -1, "need a number >= 0"),
        (["covariance"], 3, "must have 'names'"),
        (["covariance", "names"], ["fresnel_tt", "fresnel_tt"], "names a number twice"),
        (["covariance", "matrix"], [[1.0]], "must be 2 rows of 2 numbers"),
        (["covariance", "matrix"], [[1, 2], [3, 4]], "must be symmetric"),
        (["covariance", "matrix"], [[-1, 0], [0, 4]], "no negative variance"),
    ],
)
def test_damage_is_named(path, value, message, tmp_path):
    file = tmp_path / "fit.json"
    save_parameters(file, content())
    document = json.loads(file.read_text())
    damaged(document, path, value)
    file.write_text(json.dumps(document))
    with pytest.raises(InputError, match=message) as caught:
        load_parameters(file)
    assert "\n" not in str(caught.value)
    assert str(file) in str(caught.value)


def test_nothing_is_written_that_could_not_be_read(tmp_path):
    file = tmp_path / "fit.json"
    for bad in (
        content(provenance={"source": "x"}),
        content(provenance={**PROVENANCE, "loss": float("nan")}),
        content(standard_errors={"fresnel_tt": float("inf")}),
    ):
        with pytest.raises(InputError):
            save_parameters(file, bad)
    assert not list(tmp_path.iterdir())
