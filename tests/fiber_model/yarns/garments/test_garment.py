"""Garments as asked for in a [yarns] table."""

import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
import trimesh
from pydantic import TypeAdapter, ValidationError

from tests.jobs.dress_form import dress_form
from weft.fiber_model.yarns.build import run
from weft.fiber_model.yarns.catmull_rom import yarn_lengths
from weft.fiber_model.yarns.config import YarnsConfig
from weft.fiber_model.yarns.garments.mesh_files import read_mesh
from weft.fiber_model.yarns.yarn_file import load_yarns, save_yarns
from weft.files.errors import InputError

CONFIG = TypeAdapter(YarnsConfig)
SLEEVE = {"kind": "sleeve", "length_mm": 60, "cuff_girth_mm": 60, "top_girth_mm": 70, "fold_depth_mm": 3}
SCARF = {"kind": "scarf", "width_mm": 50, "length_mm": 40, "fold_depth_mm": 4}
KNIT = {"kind": "knit", "stitch_width_mm": 5}


def build(**table):
    return run(CONFIG.validate_python({"kind": "garment"} | table))


@pytest.fixture
def bowl(tmp_path):
    """Half of an icosphere of radius 30 mm, without UVs, in mm."""
    sphere = trimesh.creation.icosphere(subdivisions=3, radius=30.0)
    half = sphere.faces[sphere.triangles_center[:, 1] < 0]
    trimesh.Trimesh(sphere.vertices, half).export(tmp_path / "bowl.ply")
    return {"kind": "mesh", "file": tmp_path / "bowl.ply", "scale_to_mm": 1.0}


@pytest.mark.parametrize("surface", [SLEEVE, SCARF])
@pytest.mark.parametrize(
    "pattern", [KNIT, {"kind": "weave", "draft": "twill_2_2", "warp_per_cm": 10, "weft_per_cm": 8}]
)
def test_built_in_shapes_take_patterns(surface, pattern, tmp_path):
    yarns = build(surface=surface, pattern=pattern)
    assert np.ptp(yarns.points[:, 1]) == pytest.approx(surface["length_mm"], rel=0.15)
    assert yarns.report.covered_area_mm2 == pytest.approx(yarns.report.surface_area_mm2)
    save_yarns(yarns, tmp_path / "yarns.npz")
    again = load_yarns(tmp_path / "yarns.npz")
    assert np.array_equal(again.surface_uv, yarns.surface_uv)


def test_a_simulated_tile_goes_around_a_sleeve(shared_data):
    tile = {"kind": "tile", "tile": shared_data / "yarn_patterns" / "stockinette.pyp", "scale_to_mm": 400}
    yarns = build(surface=SLEEVE, pattern=tile)
    assert yarns.closed.sum() >= 10


def test_yarns_of_a_file_are_laid_once(tmp_path):
    flat = run(CONFIG.validate_python({"kind": "knit", "size_mm": [20, 20], "stitch_width_mm": 5}))
    save_yarns(flat, tmp_path / "flat.npz")
    yarns = build(surface=SCARF, pattern={"kind": "file", "file": tmp_path / "flat.npz"})
    assert yarns.yarn_count == flat.yarn_count
    assert yarn_lengths(yarns).sum() == pytest.approx(yarn_lengths(flat).sum(), rel=0.05)


def test_a_mesh_without_uv_is_unwrapped(bowl):
    pytest.importorskip("xatlas", reason="xatlas is an extra: pip install xatlas")
    yarns = build(surface=bowl, pattern=KNIT)
    report = yarns.report
    assert report.covered_area_mm2 == pytest.approx(report.surface_area_mm2)
    assert report.stretch_middle[0] > 0.6
    assert report.stretch_middle[1] < 1.7
    depth = np.linalg.norm(yarns.points, axis=1) - 30
    assert np.abs(depth).max() < 1.5


def test_without_xatlas_the_message_says_what_to_install(bowl, monkeypatch):
    monkeypatch.setitem(sys.modules, "xatlas", None)
    with pytest.raises(InputError, match=r"bowl\.ply: .*no surface coordinates.*pip install xatlas"):
        build(surface=bowl, pattern=KNIT)


def test_asking_for_uv_that_the_file_lacks_is_refused(bowl):
    with pytest.raises(InputError, match=r"bowl\.ply: .*uv = 'unwrap'"):
        build(surface=bowl | {"uv": "file"}, pattern=KNIT)


def test_same_table_same_bits():
    first, second = (build(surface=SLEEVE, pattern=KNIT) for _ in range(2))
    assert np.array_equal(first.points, second.points)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"surface": SLEEVE, "pattern": KNIT | {"size_mm": [9, 9]}}, "remove 'size_mm'"),
        ({"surface": SLEEVE | {"fold_depth_mm": 30}, "pattern": KNIT}, "too deep"),
        ({"surface": SLEEVE | {"fold_count": 30}, "pattern": KNIT}, "too steep"),
        ({"surface": SCARF | {"fold_count": 30}, "pattern": KNIT}, "too steep"),
        ({"surface": {"kind": "sock"}, "pattern": KNIT}, "sock"),
        ({"surface": SLEEVE, "pattern": {"kind": "garment"}}, "garment"),
        ({"surface": {"kind": "mesh", "file": "m.obj"}, "pattern": KNIT}, "'scale_to_mm' must be given"),
        ({"surface": {"kind": "mesh", "file": "m.stl", "scale_to_mm": 1}, "pattern": KNIT}, "cannot read"),
        ({"surface": {"kind": "mesh", "file": "m.glb", "up_axis": "z"}, "pattern": KNIT}, "remove 'up_axis'"),
    ],
)
def test_bad_tables_are_refused(tmp_path, monkeypatch, table, message):
    monkeypatch.chdir(tmp_path)
    for name in ("m.obj", "m.stl", "m.glb"):
        (tmp_path / name).write_text("")
    with pytest.raises(ValidationError, match=message):
        CONFIG.validate_python({"kind": "garment"} | table)


def test_the_arm_of_the_example_fits_into_its_sleeve():
    """Every yarn stays outside of it, and within a few mm."""
    job = tomllib.loads((Path(__file__).parents[4] / "configs/examples/sleeve.toml").read_text())
    (arm,) = job["render"]["surfaces"]
    yarns = run(CONFIG.validate_python(job["yarns"]))
    from_axis = np.hypot(yarns.points[:, 0], yarns.points[:, 2]) - np.repeat(yarns.radius, yarns.point_counts)
    assert 0.2 < from_axis.min() - arm["radius_mm"] < 2.0
    low, high = yarns.bounds[:, 1]
    (_, bottom, _), (_, top, _) = arm["points_mm"]
    assert bottom < low < high < top


def test_the_dress_form_stands_inside_of_the_shirt(shared_data):
    """Closed, and nowhere nearer to the cloth than yarns are thick; at the chest no farther than a hand."""
    from scipy.spatial import cKDTree

    shirt = shared_data / "garments" / "unisex_shirt.usd"
    cloth = read_mesh(shirt, scale_to_mm=10.0, up_axis=1)
    form = trimesh.Trimesh(*dress_form(cloth.vertices, cloth.faces), process=False)
    assert form.is_volume
    surface = trimesh.Trimesh(cloth.vertices, cloth.faces, process=False)
    on_cloth = np.asarray(trimesh.sample.sample_surface(surface, 40_000, seed=2)[0])
    distance = cKDTree(trimesh.sample.sample_surface(form, 200_000, seed=3)[0]).query(on_cloth)[0]
    assert distance.min() > 4.0
    chest = (np.abs(on_cloth[:, 1] - 1300) < 60) & (np.abs(on_cloth[:, 0]) < 100)
    assert np.median(distance[chest]) < 25.0
