"""Scenes that cannot be: `weft check` says so in one line with the key or file, and exits with 2."""

from __future__ import annotations

import pytest

from weft.pipeline.cli import exit_code

from .test_cli import KNIT, job

SURFACE = """
[[render.surfaces]]
kind = "mesh"
file = "m.obj"
"""
LIGHT = """
[[render.lights]]
kind = "{kind}"
position_mm = [0, 50, 0]
radiance = [1, 1, 1]
"""
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"

SCENES = {
    "missing texture": (
        SURFACE + 'material = { kind = "diffuse", texture = "gone.png" }',
        TRIANGLE,
        "file not found: ",
    ),
    "missing mesh": (SURFACE.replace("m.obj", "n.obj"), TRIANGLE, "did you mean 'm.obj'?"),
    "degenerate triangles": (SURFACE, "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "have no area"),
    "vertex that is not a number": (SURFACE, "v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "not finite"),
    "quad of no area": (
        LIGHT.format(kind="quad") + "width_mm = 0\nheight_mm = 5",
        TRIANGLE,
        "width_mm: found 0; must be greater than 0",
    ),
    "disk of no area": (LIGHT.format(kind="disk") + "radius_mm = 0", TRIANGLE, "radius_mm: found 0"),
    "mesh light of no area": (
        '\n[[render.lights]]\nkind = "mesh"\nfile = "m.obj"\nradiance = [1, 1, 1]\n',
        "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n",
        "have no area",
    ),
    "film without pixels": ("resolution = [0, 16]", TRIANGLE, "greater than or equal to 1"),
    "medium of negative extinction": (
        '\n[[render.media]]\nkind = "homogeneous"\nextinction_per_mm = [1, -1, 1]\n'
        'bound = { kind = "ball", radius_mm = 1 }\n',
        TRIANGLE,
        "extinction_per_mm",
    ),
    "box of no volume": (
        '\n[[render.media]]\nkind = "homogeneous"\nextinction_per_mm = 1\n'
        'bound = { kind = "box", lower_mm = [0, 0, 0], upper_mm = [1, 0, 1] }\n',
        TRIANGLE,
        "lower_mm must lie below upper_mm",
    ),
}


@pytest.mark.parametrize("name", SCENES)
def test_it_is_refused_in_one_line(tmp_path, capsys, name):
    text, mesh, message = SCENES[name]
    (tmp_path / "m.obj").write_text(mesh)
    knit = KNIT.replace("resolution = [16, 16]\n", "") if "resolution" in text else KNIT
    assert exit_code(["check", str(job(tmp_path, knit + text + "\n"))]) == 2
    said = capsys.readouterr().err.strip()
    assert message in said
    assert "Traceback" not in said
    assert len([line for line in said.splitlines() if ": " in line]) == 1, said
