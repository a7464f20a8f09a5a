"""Several cameras and turntables: a file for each picture, each fresh or stale by itself."""

from __future__ import annotations

import numpy as np
import pytest

from weft.files.errors import InputError
from weft.pipeline.cli import exit_code
from weft.pipeline.config import load
from weft.pipeline.pictures_of import jobs_of_pictures, picture_files
from weft.renderer.camera import place_camera
from weft.renderer.image import read_rgb
from weft.renderer.turned_lights import turned_lights

from .test_cli import KNIT, job

CAMERAS = """\
[[render.cameras]]
name = "front"
kind = "perspective"
[[render.cameras]]
name = "close-up"
kind = "orthographic"
frame_width_mm = 5
"""
TURNTABLE = "[render.turntable]\nframes = 4\n"
SUN = '[[render.lights]]\nkind = "directional"\ndirection = [1, 0, 0]\n'
ASKEW = '[render.camera]\nkind = "perspective"\norbit_deg = 5\norbit_axis = "z"\n'
BOUNDS = np.array([[-3.0, -2.0, -0.5], [5.0, 4.0, 1.0]])


def files_of(tmp_path, text):
    return [picture_files(one)["image"] for one in jobs_of_pictures(load(job(tmp_path, text)))]


def test_one_camera_makes_one_picture(tmp_path):
    assert files_of(tmp_path, KNIT) == ["image.exr"]


def test_each_camera_names_its_picture(tmp_path):
    assert files_of(tmp_path, KNIT + CAMERAS) == ["job.front.exr", "job.close-up.exr"]


def test_a_turntable_numbers_its_pictures(tmp_path):
    assert files_of(tmp_path, KNIT + CAMERAS + TURNTABLE)[2:] == [f"job.turn_00{i}.exr" for i in range(4)]


def test_on_a_turntable_the_cloth_turns_and_its_light_does_not(tmp_path):
    """Seen from the camera, a point of the cloth goes around its middle and the sun stays where it is."""
    suns, places = [], []
    point = np.array([5.0, 1.0, 0.25])
    for part in jobs_of_pictures(load(job(tmp_path, KNIT + TURNTABLE + SUN))):
        table = part.table("render")
        axes = place_camera(table.camera, BOUNDS, (16, 16)).axes
        (sun,) = turned_lights(table.lights, table.lights_turn_deg, BOUNDS.mean(axis=0))
        suns.append(axes @ np.array(sun.direction))
        places.append(axes @ (point - BOUNDS.mean(axis=0)))
    np.testing.assert_allclose(suns, [suns[0]] * 4, atol=1e-12)
    # x to the right, z toward the camera: counterclockwise seen from above goes right, away, left, near
    np.testing.assert_allclose(places, [[4, 0, 0], [0, 0, -4], [-4, 0, 0], [0, 0, 4]], atol=1e-12)


def test_a_camera_that_goes_around_leaves_the_light_with_the_cloth(tmp_path):
    parts = jobs_of_pictures(load(job(tmp_path, KNIT + TURNTABLE + 'turn = "camera"\naxis = "x"\n')))
    assert [part.table("render").lights_turn_deg for part in parts] == [0, 0, 0, 0]
    assert [part.table("render").camera.orbit_deg for part in parts] == [0, 90, 180, 270]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (CAMERAS.replace('name = "front"\n', ""), "camera 1 of 2 has no name"),
        (CAMERAS.replace("close-up", "front"), "several cameras are named 'front'"),
        (CAMERAS.replace("front", "../front"), "should match pattern"),
        (CAMERAS.replace("front", "turn_002") + TURNTABLE, "a camera is named 'turn_002'"),
        ('[render.camera]\nkind = "perspective"\n' + CAMERAS, "has no effect beside"),
        (TURNTABLE + 'axis = "x"\n', "cloth"),
        (TURNTABLE + ASKEW, "orbit_axis"),
    ],
)
def test_what_has_no_meaning_is_refused(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        load(job(tmp_path, KNIT + text))


@pytest.mark.gl
def test_only_the_camera_that_changed_is_rendered_again(tmp_path, capsys):
    out = tmp_path / "job.out"
    path = job(tmp_path, KNIT + CAMERAS)
    assert exit_code(["run", str(path)]) == 0
    front = (out / "job.front.exr").read_bytes()
    assert read_rgb(out / "job.close-up.exr").mean() > 0
    assert not (out / "image.exr").exists()
    capsys.readouterr()
    job(tmp_path, KNIT + CAMERAS.replace("= 5", "= 4"))
    assert exit_code(["check", str(path)]) == 0
    assert "render job.front.exr: fresh" in capsys.readouterr().out
    assert exit_code(["run", str(path)]) == 0
    told = capsys.readouterr().err
    assert "render job.front: fresh" in told
    assert "render job.close-up: stale because render.camera.frame_width_mm changed from 5.0 to 4.0" in told
    assert (out / "job.front.exr").read_bytes() == front
