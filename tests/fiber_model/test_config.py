"""The fiber settings and the presets."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from pydantic import ValidationError

from weft.fiber_model.config import FibersConfig, VariationConfig
from weft.files.key_texts import key_text

PRESETS = ["cotton1", "cotton2", "polyester1", "rayon1", "rayon2", "rayon3", "rayon4", "silk1", "silk2"]
UNIT = 5.1  # mm per unit of the fitted files, inferred
LENGTHS = {
    "ply_pitch_mm": ("ply_pitch", 1),
    "fiber_pitch_mm": ("fiber_pitch", 1),
    "ply_center_radius_mm": ("yarn_radius", 0.5),
    "ellipse_long_mm": ("ellipse_long", 1),
    "ellipse_short_mm": ("ellipse_short", 1),
    "hair_z_span_mm": ("hair_z_span_mean", 1),
    "hair_z_span_sd_mm": ("hair_z_span_sd", 1),
    "hair_radius_mm": ("hair_R_min_mean", 1),
    "hair_radius_sd_mm": ("hair_R_min_sd", 1),
    "hair_radius_span_mm": ("hair_R_span_mean", 1),
    "hair_radius_span_sd_mm": ("hair_R_span_sd", 1),
    "loop_radius_mm": ("loop_R_max_mean", 1),
    "loop_radius_sd_mm": ("loop_R_max_sd", 1),
}
DENSITIES = {"hair_density_per_mm": "hair_density", "loop_density_per_mm": "loop_density"}
NUMBERS = {
    "plies": "plies",
    "fibers_per_ply": "fibers_per_ply",
    "cross_section_epsilon": "epsilon",
    "cross_section_beta": "beta",
    "migration_per_turn": "migration_s",
    "migration_min": "migration_R_min",
}
ANGLES = {"hair_angle_span_deg": "hair_theta_span_mean", "hair_angle_span_sd_deg": "hair_theta_span_sd"}


@pytest.mark.parametrize("preset", PRESETS)
def test_presets_are_the_published_values_in_millimeters(preset, fiber_config, shared_data) -> None:
    with open(shared_data / "tables" / "yarn_presets_zhao2016.csv", encoding="utf-8") as file:
        rows = csv.DictReader(line for line in file if not line.startswith("#"))
        published = next(row for row in rows if row["name"] == preset)
    config = fiber_config(preset)
    for key, (column, factor) in LENGTHS.items():
        value = float(published[column]) * UNIT * factor
        assert abs(getattr(config, key)) == pytest.approx(abs(value), rel=1e-5), key
    for key, column in DENSITIES.items():
        assert getattr(config, key) == pytest.approx(float(published[column]) / UNIT, rel=1e-5), key
    for key, column in NUMBERS.items():
        assert getattr(config, key) == float(published[column]), key
    for key, column in ANGLES.items():
        assert getattr(config, key) == pytest.approx(float(published[column]) * 180 / 3.14159265, rel=1e-5), (
            key
        )
    assert config.flyaway_sd_factor == 0.5


@pytest.mark.parametrize("preset", [*PRESETS, "wool1"])
def test_plies_and_fibers_turn_in_opposite_directions(preset, fiber_config) -> None:
    config = fiber_config(preset)
    assert config.ply_pitch_mm * config.fiber_pitch_mm < 0


@pytest.mark.parametrize(("preset", "tex"), [("wool1", 71.4), ("linen1", 50.0)])
def test_estimated_yarns_have_the_weight_that_they_say(preset, tex, fiber_config) -> None:
    """Grams per kilometer, from the number of fibers, their section and the density of wool and flax."""
    config = fiber_config(preset)
    grams_per_mm3 = {"wool1": 1.31e-3, "linen1": 1.50e-3}[preset]
    section = config.plies * config.fibers_per_ply * np.pi * config.fiber_radius_mm**2
    assert section * grams_per_mm3 * 1e6 == pytest.approx(tex, rel=0.02)


def test_a_forgotten_preset_is_one_clear_line() -> None:
    with pytest.raises(ValidationError) as error:
        FibersConfig()  # type: ignore[call-arg]
    assert error.value.error_count() == 1
    assert "set 'preset'" in str(error.value)


def test_refuses_unknown_keys_and_impossible_values(fiber_config) -> None:
    for values in (
        {"fuz": 1.0},
        {"fuzz": -1.0},
        {"plies": 0},
        {"fiber_radius_mm": float("nan")},
        {"scale": "big"},
        {"by_type": {"weft": {"fuz": 1}}},
        {"by_type": {"weft": {"seed": 1}}},
        {"by_type": {"weft": {"plies": 0}}},
    ):
        with pytest.raises(ValidationError):
            fiber_config("cotton1", **values)


def test_every_key_is_described() -> None:
    assert all(key_text(FibersConfig, name) for name in FibersConfig.model_fields)


def test_a_yarn_type_changes_only_its_own_values(fiber_config) -> None:
    config = fiber_config("cotton1", by_type={"weft": {"plies": 2, "fiber_count_scale": 3.0}})
    assert config.for_type("warp") is config
    changed = {k: v for k, v in config.for_type("weft") if v != getattr(config, k)}
    assert changed == {"plies": 2, "fiber_count_scale": 3.0}


def test_a_yarn_type_has_its_own_variation_and_hairs(fiber_config) -> None:
    """A table given for a type replaces the whole table of the others."""
    config = fiber_config(
        "linen1",
        by_type={
            "weft": {"variation": {"slubs_per_m": 9.0}},
            "warp": {"walk_hairs": {"density_per_mm": 1, "length_mm": 2, "persistence_mm": 3}},
        },
    )
    assert config.variation.thickness_sd == 0.11
    assert config.for_type("weft").variation == VariationConfig(slubs_per_m=9.0)
    assert config.for_type("warp").variation == config.variation
    assert config.for_type("warp").walk_hairs.length_mm == 2
    assert config.walk_hairs is None


def test_refuses_impossible_variation_and_hairs(fiber_config) -> None:
    walk, droop = (
        {"density_per_mm": 1.0, "length_mm": 1.0, key: 1.0} for key in ("persistence_mm", "bend_mm")
    )
    fiber_config("cotton1", walk_hairs=walk, droop_hairs=droop)
    for values in (
        {"cords": 0},
        {"cord_pitch_mm": 1e-9},
        {"variation": {"slub_thickness": 0.5}},
        {"variation": {"thickness_sd": 0.9}},
        {"variation": {"slub_length_mm": 0.0}},
        {"walk_hairs": {**walk, "density_per_mm": 0.0}},
        {"walk_hairs": {**walk, "bend_mm": 1.0}},
        {"droop_hairs": {**droop, "down": (0.0, 0.0, 0.0)}},
    ):
        with pytest.raises(ValidationError):
            fiber_config("cotton1", **values)


def test_errors_name_the_key_of_the_yarn_type(fiber_config) -> None:
    with pytest.raises(ValidationError) as error:
        fiber_config("cotton1", by_type={"weft": {"plies": -1, "fuz": 1}})
    assert [e["loc"] for e in error.value.errors()] == [
        ("by_type", "weft", "plies"),
        ("by_type", "weft", "fuz"),
    ]


def test_a_range_of_migration_that_ends_before_it_begins_is_refused(fiber_config) -> None:
    values = fiber_config("cotton1").model_dump(exclude_unset=True)
    with pytest.raises(ValidationError, match=r"migration_min 0.9 must not exceed migration_max 0.5"):
        FibersConfig.model_validate(values | {"migration_min": 0.9, "migration_max": 0.5})
    with pytest.raises(ValidationError, match=r"by_type.weft: migration_min 1 must not exceed"):
        FibersConfig.model_validate(
            values | {"by_type": {"weft": {"migration_min": 1.0, "migration_max": 0.5}}}
        )
