"""The [scattering] table: presets hold the published numbers, mistakes are named."""

from __future__ import annotations

import csv
from math import degrees

import pytest
from pydantic import ValidationError

from tests.fiber_model.scattering.scattering_cases import PRESET_NAMES, preset
from weft.fiber_model.scattering.config import ScatteringConfig

TABLE = {
    "longitudinal_width_r_deg": 6,
    "longitudinal_width_tt_deg": 12,
    "longitudinal_width_trt_deg": 24,
    "azimuthal_width_tt_deg": 220,
    "fresnel_r": 0.01,
    "fresnel_tt": 0.85,
}


def rows(folder, name):
    lines = (folder / "tables" / name).read_text(encoding="utf-8").splitlines()
    return list(csv.DictReader(line for line in lines if not line.startswith("#")))


def widths(parameters):
    betas = (parameters.longitudinal_width_r, parameters.longitudinal_width_tt)
    return [degrees(angle) for angle in (*betas, parameters.azimuthal_width_tt)]


def test_thesis_presets_hold_table_6_1(shared_data):
    for row in rows(shared_data, "scattering_thesis_table_6_1.csv"):
        parameters = preset(row["name"])
        assert widths(parameters) == pytest.approx(
            [float(row[key]) for key in ("beta_R_deg", "beta_TT_deg", "gamma_TT_deg")]
        )
        assert degrees(parameters.longitudinal_width_trt) == pytest.approx(float(row["beta_TRT_deg"]))
        assert parameters.fresnel_tt == float(row["fresnel_TT"])
        assert parameters.fresnel_r == (float(row["fresnel_R"]),) * 3


def test_khungurn_presets_hold_the_fitted_table(shared_data):
    table = rows(shared_data, "scattering_khungurn2015.csv")
    assert len(table) == 5
    for row in table:
        parameters = preset(f"khungurn2015_{row['fabric']}")
        assert widths(parameters) == pytest.approx(
            [float(row[key]) for key in ("beta_R_deg", "beta_TT_deg", "gamma_TT_deg")]
        )
        assert parameters.fresnel_r == tuple(float(row[f"C_R_{c}"]) for c in "rgb")
        assert parameters.color_tt == tuple(float(row[f"C_TT_{c}"]) for c in "rgb")
        assert parameters.color_r == (1.0, 1.0, 1.0)
        assert parameters.fresnel_tt == 1.0


@pytest.mark.parametrize("name", PRESET_NAMES)
def test_presets_take_color_overrides(name):
    assert preset(name, color_tt=[0.1, 0.2, 0.3]).color_tt == (0.1, 0.2, 0.3)
    assert preset(name, color_tt=0.5).color_tt == (0.5, 0.5, 0.5)


def test_trt_is_uniform_unless_it_has_a_width():
    assert preset("reference").azimuthal_width_trt is None
    assert preset("reference", azimuthal_width_trt_deg="uniform").azimuthal_width_trt is None
    width = preset("reference", azimuthal_width_trt_deg=40).azimuthal_width_trt
    assert degrees(width) == pytest.approx(40)


def test_types_have_lobes_of_their_own():
    config = ScatteringConfig(**TABLE, by_type={"warp": {**TABLE, "fresnel_r": 0.2}})
    assert config.parameters_for("warp").fresnel_r == (0.2, 0.2, 0.2)
    assert config.parameters_for("weft").fresnel_r == (0.01, 0.01, 0.01)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"longitudinal": "symmetrical"}, "'gaussian', 'vmf' or 'symmetric'"),
        ({"fresnel_r": 1.5}, "less than or equal to 1"),
        ({"longitudinal_width_tt_deg": 0.1}, "greater than or equal to 0.5"),
        ({"azimuthal_width_tt_deg": float("nan")}, "finite"),
        ({"azimuthal_width_trt_deg": 500}, "less than or equal to 300"),
        ({"colour_tt": 1}, "Extra inputs"),
    ],
)
def test_mistakes_are_named(changes, message):
    with pytest.raises(ValidationError, match=message):
        ScatteringConfig(**{**TABLE, **changes})
