"""Wrong jobs, one idea each: exit code 2, the place, one line, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from weft.files.errors import InputError
from weft.pipeline.cli import exit_code
from weft.voxelize import openvdb_library

JOB = """\
[yarns]
kind = "weave"
size_mm = [3, 3]
[fibers]
preset = "cotton2"
[voxelize]
voxel_size_mm = 0.2
formats = ["nvdb"]
[scattering]
preset = "reference"
[render]
resolution = [8, 8]
[[render.lights]]
kind = "studio"
"""
YARN_FILE = '[yarns]\nkind = "file"\nfile = "yarns.npz"\n'


def complaints(tmp_path, capsys, text, *options, command="check"):
    """Lines on standard error but the progress of the stages, with the job's folder left out."""
    path = tmp_path / "job.toml"
    path.write_text(text, encoding="utf-8")
    assert exit_code([command, str(path), *options]) == 2
    shown = capsys.readouterr()
    assert shown.out == ""  # nor "no mistakes found" ahead of one
    lines = shown.err.splitlines()
    return [line.replace(f"{tmp_path}/", "") for line in lines if ": stale because" not in line]


@pytest.mark.parametrize(
    ("option", "expected"),
    [
        ("voxelize.voxel_size_mm=1e-320", "must be greater than or equal to"),
        ("voxelize.voxel_size_mm=1e30", "must be less than or equal to 1000"),
        ("voxelize.formats=[]", "voxelize.formats: found []; must have at least 1 items"),
        ("voxelize.region_mm=[0,0,0,1,1,1]", "must have at most 2 items"),
        ("fibers.fiber_radius_mm=1e300", "must be less than or equal to"),
        ("fibers.ply_pitch_mm=1e-300", "fibers.ply_pitch_mm: is 1e-300; must be 0 or at least 1e-06"),
        ("fibers.by_type.yarn.fiber_pitch_mm=1e-300", "is 1e-300; must be 0 or at least 1e-06"),
        ("fibers.migration_max=1e30", "must be less than or equal to 100"),
        ("export.yarns=[5,2]", "export: yarns must rise from 0 or more, found [5, 2]"),
        ("export.arc_length_mm=[0,1e308]", "must be less than or equal to"),
        ("export.box_mm=[[1,1,1],[0,0,0]]", "the first corner of box_mm must lie below the second"),
        ("output.folder='~nobody-of-this-name'", "there is no such home folder: ~nobody"),
        ('output.folder="a\\u0000b"', "no path can hold a null character"),
        (".".join("a" * 100) + "=1", "no key of a job has more than 64 parts"),
        ("yarns.file='/" + "a" * 5000 + "'", "unknown key"),
        ("render.volume='/" + "a" * 5000 + "'", "render.volume: file name too long: /aaaa"),
        ("render.detail_pixels=0", "must be greater than 0"),
        ("render.volume='~nobody-of-this-name/x.vdb'", "there is no such home folder: ~nobody"),
    ],
)
def test_wrong_value_is_one_line_that_names_the_option(tmp_path, capsys, option, expected):
    (line,) = complaints(tmp_path, capsys, JOB, "--set", option)
    assert line.startswith(f"--set {option}: ")
    assert expected in line


def test_detail_without_levels_is_told_before_the_work(tmp_path, capsys):
    (line,) = complaints(tmp_path, capsys, JOB, "--set", "render.detail_pixels=1")
    assert line == "job.toml: render.detail_pixels chooses among coarser levels: set voxelize.levels = 3"


@pytest.mark.parametrize(
    ("option", "place"),
    [
        ("render.lights=[{kind='moon'}]", "render.lights[0].kind: found 'moon'"),
        ("voxelize.formats=['usd']", "voxelize.formats[0]: found 'usd'"),
        ("scattering.color_tt=[-1,0,0]", "scattering.color_tt[0]: found -1"),
    ],
)
def test_wrong_element_is_told_once_and_placed_where_its_array_was_written(tmp_path, capsys, option, place):
    (line,) = complaints(tmp_path, capsys, JOB, "--set", option)
    assert line.startswith(f"--set {option}: {place}; must be ")


def test_control_characters_of_a_value_reach_no_terminal(tmp_path, capsys):
    (line,) = complaints(tmp_path, capsys, '[yarns]\nkind = "we\\u001b[31mave\\n"\nsize_mm = [3, 3]\n')
    assert "found 'we\\x1b[31mave\\n'" in line


def test_missing_key_says_what_it_is(tmp_path, capsys):
    lines = complaints(tmp_path, capsys, '[yarns]\nkind = "knit"\nsize_mm = [3, 3]\n')
    assert lines == [
        "job.toml:1: yarns.stitch_width_mm: is missing "
        "(width of one stitch (a wale), which sets the gauge across the cloth)"
    ]


@pytest.mark.parametrize(
    "text", [".".join(["a"] * 3000) + " = 1\n", "a = " + "[" * 300 + "]" * 300 + "\n"], ids=["dots", "arrays"]
)
def test_deep_nesting_is_refused(tmp_path, capsys, text):
    assert complaints(tmp_path, capsys, text) == ["job.toml: nested too deeply for a config file"]


def test_endless_device_is_no_job(capsys):
    assert exit_code(["check", "/dev/zero"]) == 2
    assert capsys.readouterr().err == "/dev/zero: is too large; a config file has at most 4 MiB\n"


def test_byte_order_mark_is_read_over(tmp_path, capsys):
    (line,) = complaints(tmp_path, capsys, "\ufeff" + JOB.replace("[3, 3]", "[3, -3]"))
    assert line == "job.toml:3: yarns.size_mm[1]: found -3; must be greater than 0"


def test_cloth_without_end_is_refused_at_its_size(tmp_path, capsys):
    (line,) = complaints(tmp_path, capsys, JOB.replace("[3, 3]", "[9e6, 9e6]"), command="yarns")
    assert line.startswith("job.toml:3: yarns.size_mm: this weave would have 3,732,480,000,000,000 control")


def test_star_is_no_yarn_type(tmp_path, capsys):
    """The file of the scattering has an entry of this name, for all yarns."""
    text = JOB.replace('cotton2"', 'cotton2"\nfiber_count_scale = 0.05')
    *_, line = complaints(
        tmp_path, capsys, text + '[scattering.by_type."*"]\ncolor_tt = 0.5\n', command="run"
    )
    assert line.startswith("job.toml:16: scattering.by_type.*: there is no yarn type of this name")


@pytest.mark.parametrize(
    ("field", "value", "expected"),
    [
        ("type_names", np.array(["../x y"]), "'../x y' is no name of a yarn type"),
        ("points", np.ones((5, 3), complex), "not a readable .npz yarn file"),
        ("points", np.array([{}, None], dtype=object), "not a readable .npz yarn file"),
        ("offsets", np.array([0.0, np.nan]), "not a readable .npz yarn file"),
        ("offsets", np.array([0, 500]), "yarn offsets must rise from 0"),
    ],
)
def test_yarn_file_with_a_foreign_field_is_refused(tmp_path, capsys, field, value, expected):
    fields = {
        "schema": np.array("weft.yarns"),
        "schema_version": np.array(1),
        "points": np.arange(15.0).reshape(5, 3),
        "offsets": np.array([0, 5]),
        "closed": np.array([False]),
        "radius": np.array([1.0]),
        "yarn_type": np.array([0]),
        "type_names": np.array(["yarn"]),
    }
    np.savez(tmp_path / "yarns.npz", **fields | {field: value})
    (line,) = complaints(tmp_path, capsys, YARN_FILE, command="yarns")
    assert line.startswith("yarns.npz: ")
    assert expected in line


@pytest.mark.parametrize("command", ["check", "run"])
def test_missing_openvdb_is_told_before_the_work(tmp_path, capsys, monkeypatch, command):
    def missing():
        raise InputError(".vdb needs OpenVDB")

    monkeypatch.setattr(openvdb_library, "extension", missing)
    *_, line = complaints(tmp_path, capsys, JOB.replace("nvdb", "vdb"), command=command)
    assert line == ".vdb needs OpenVDB"
    assert not (tmp_path / "job.out" / "volume.vdb").exists()


def test_without_openvdb_nvdb_needs_nothing(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(openvdb_library, "extension", lambda: pytest.fail("OpenVDB was asked for"))
    path = tmp_path / "job.toml"
    path.write_text(JOB)
    assert exit_code(["check", str(path)]) == 0


def test_null_character_in_an_include(tmp_path, capsys):
    (line,) = complaints(tmp_path, capsys, 'include = ["a\\u0000b.toml"]\n')
    assert line.startswith("job.toml:1: include: must be a list of files")


@pytest.mark.parametrize("command", ["check", "inspect"])
def test_names_that_lead_nowhere(tmp_path, capsys, command):
    (tmp_path / "loop.toml").symlink_to("loop.toml")
    for name in ("loop.toml", "a" * 300 + ".toml"):
        assert exit_code([command, str(tmp_path / name)]) == 2
        assert len(capsys.readouterr().err.splitlines()) == 1


def test_schema_does_not_replace_a_folder(tmp_path, capsys):
    assert exit_code(["schema", str(tmp_path)]) == 2
    assert capsys.readouterr().err.endswith("is a folder, not a file\n")
