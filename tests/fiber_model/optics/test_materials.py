"""The six materials are what their notes say."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from weft.fiber_model.optics.cross_sections import build_outline
from weft.fiber_model.optics.light_transport import run
from weft.fiber_model.optics.materials import MATERIALS, material_optics
from weft.files.errors import InputError

EACH = [(material.name, shape) for material in MATERIALS.values() for shape in material.cross_sections]
AREAS_UM2 = {"cotton": 112, "wool": 314, "silk": 98, "polyester": 121, "nylon": 149, "viscose": 112}
"""Linear density over mass density, as the notes give them; wool: a disk of 20 µm."""


@pytest.mark.parametrize(("name", "shape"), EACH)
def test_every_cross_section_has_the_fineness_of_the_note(name: str, shape: str) -> None:
    area = build_outline(MATERIALS[name].cross_sections[shape]).area * 1e6
    assert area == pytest.approx(AREAS_UM2[name], rel=0.02)


@pytest.mark.parametrize(("name", "shape"), EACH)
def test_clean_fibers_scatter_nearly_all_light(name: str, shape: str) -> None:
    result = run(material_optics(name, shape, paths=20_000, theta_i_deg=(0,)))
    red, green, blue = result.albedo()[0][0]
    assert red >= green >= blue > 0.95
    assert not result.lost_counts.any()


def test_refractive_indices_are_those_of_the_table(shared_data: Path) -> None:
    rows = (shared_data / "tables" / "refractive_indices.csv").read_text(encoding="utf-8").splitlines()
    table = {row["fiber"]: row for row in csv.DictReader(row for row in rows if not row.startswith("#"))}
    for name, material in MATERIALS.items():
        row = table["nylon66" if name == "nylon" else name]
        assert (material.index_along, material.index_across) == (float(row["n_par"]), float(row["n_perp"]))


def test_what_is_not_there_is_named_with_what_is() -> None:
    with pytest.raises(InputError, match=r"no fiber material 'linen'. Known: cotton, wool"):
        material_optics("linen")
    with pytest.raises(InputError, match=r"wool has no cross-section 'kidney'. Known: circle, ellipse"):
        material_optics("wool", "kidney")
