"""--crop, --samples, --time and --noise of `weft render`: short for values of [render]."""

from __future__ import annotations

import json

import numpy as np
import pytest

from weft.files.errors import InputError
from weft.pipeline.cli import exit_code
from weft.pipeline.commands.render_options import MOST_SAMPLES, PictureOptions, seconds_of
from weft.renderer.image import read_rgb

from .test_cli import KNIT, job


def test_corners_become_left_top_width_and_height():
    assert PictureOptions(crop=(4, 2, 12, 8)).overrides() == ("render.crop=[4, 2, 8, 6]",)


@pytest.mark.parametrize("corners", [(4, 2, 4, 8), (4, 8, 12, 2), (-1, 0, 3, 3)])
def test_a_crop_without_pixels_is_refused(corners):
    with pytest.raises(InputError, match="no pixel lies between"):
        PictureOptions(crop=corners).overrides()


@pytest.mark.parametrize(
    ("text", "seconds"), [("90", 90), ("60s", 60), ("1.5 min", 90), ("2h", 7200), (".5s", 0.5)]
)
def test_times_have_units(text, seconds):
    assert seconds_of(text) == seconds


@pytest.mark.parametrize("text", ["", "soon", "5 parsecs", "-3s", "1e3s"])
def test_what_is_no_time_is_refused(text):
    with pytest.raises(InputError, match="Write 90s, 5min or 2h"):
        seconds_of(text)


def test_a_stopping_rule_lifts_the_jobs_number_of_samples_but_not_the_one_given():
    assert f"render.samples_per_pixel={MOST_SAMPLES}" in PictureOptions(noise=0.02).overrides()
    assert f"render.samples_per_pixel={MOST_SAMPLES}" in PictureOptions(time="1s").overrides()
    assert "render.samples_per_pixel=64" in PictureOptions(time="1s", samples=64).overrides()


@pytest.mark.gl
def test_a_crop_has_the_bits_of_the_whole_and_the_line_tells_what_was_taken(tmp_path, capsys):
    path, out = job(tmp_path, KNIT), tmp_path / "job.out"
    assert exit_code(["run", str(path), "--samples", "3"]) == 0
    assert "16 x 16, 3 samples per pixel" in capsys.readouterr().err
    whole = read_rgb(out / "image.exr")
    assert exit_code(["render", str(path), "--samples", "3", "--crop", "5", "2", "12", "9"]) == 0
    np.testing.assert_array_equal(read_rgb(out / "image.exr"), whole[2:9, 5:12])
    assert exit_code(["render", str(path), "--noise", "0.2"]) == 0
    taken = json.loads((out / "image.run.json").read_text())["report"]["samples_per_pixel"]
    assert 2 <= taken < 1000
    assert f"16 x 16, {taken} samples per pixel" in capsys.readouterr().err
