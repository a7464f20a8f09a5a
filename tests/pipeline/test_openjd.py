"""Templates for render farms: valid, and run by openjd-cli to the bits of one run."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from weft.pipeline.cli import exit_code
from weft.pipeline.config import load
from weft.pipeline.openjd import job_template
from weft.renderer.image import read_exr

from .test_cli import KNIT, job
from .test_frames import sequence  # noqa: F401

OPENJD = Path(sys.executable).with_name("openjd")
needs_openjd = pytest.mark.skipif(not OPENJD.is_file(), reason="openjd-cli is not installed")
TEXT = KNIT.replace("samples_per_pixel = 1", "samples_per_pixel = 40\nblock_samples = 8")


def openjd(*arguments):
    return subprocess.run(
        [str(OPENJD), *map(str, arguments)], capture_output=True, text=True, timeout=300, check=False
    )


def test_steps_follow_the_chain(tmp_path):
    template = job_template(load(job(tmp_path, TEXT)), 2, tmp_path)
    assert [step["name"] for step in template["steps"]] == ["yarns", "voxelize", "render", "merge"]
    after = [[one["dependsOn"] for one in step.get("dependencies", [])] for step in template["steps"]]
    assert after == [[], ["yarns"], ["voxelize"], ["render"]]
    (blocks,) = template["steps"][2]["parameterSpace"]["taskParameterDefinitions"]
    assert blocks["range"] == ["0:2", "2:4", "4:5"]


def test_every_picture_of_a_turntable_is_merged(tmp_path):
    template = job_template(load(job(tmp_path, TEXT + "[render.turntable]\nframes = 3\n")), 5, tmp_path)
    merges = [step["name"] for step in template["steps"] if step["name"].startswith("merge")]
    assert len(merges) == 3


def test_pictures_without_a_known_number_of_samples_are_refused(tmp_path, capsys):
    path = job(tmp_path, TEXT.replace("[render]", "[render]\nnoise = 0.1"))
    assert exit_code(["submit", str(path), "--openjd", str(tmp_path / "farm.json")]) == 2
    assert "do not say how many blocks" in capsys.readouterr().err


@needs_openjd
@pytest.mark.gl
def test_openjd_runs_the_template_to_the_bits_of_one_run(tmp_path):
    path, template = job(tmp_path, TEXT), tmp_path / "farm.json"
    assert exit_code(["submit", str(path), "--openjd", str(template), "--blocks-per-task", "3"]) == 0
    checked = openjd("check", template)
    assert checked.returncode == 0, checked.stdout + checked.stderr
    weft = Path(sys.executable).with_name("weft")
    done = openjd("run", template, "-p", f"Weft={weft}")
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-2000:]
    farm, _ = read_exr(tmp_path / "job.out" / "image.exr")
    assert exit_code(["run", str(path), "--output", str(tmp_path / "one")]) == 0
    one, _ = read_exr(tmp_path / "one" / "image.exr")
    for name, data in one.items():
        np.testing.assert_array_equal(data, farm[name], err_msg=name)


def test_frames_are_tasks_of_every_step(sequence, tmp_path):  # noqa: F811
    template = job_template(load(sequence, frame=1), 1, tmp_path, [1, 2, 3])
    for step in template["steps"]:
        frames, *blocks = step["parameterSpace"]["taskParameterDefinitions"]
        assert frames["range"] == ["0001", "0002", "0003"]
        assert [one["name"] for one in blocks] == (["Blocks"] if step["name"] == "render" else [])


@needs_openjd
@pytest.mark.proof
@pytest.mark.gl
def test_openjd_runs_a_sequence_to_the_bits_of_one_run(sequence, tmp_path):  # noqa: F811
    template, alone = tmp_path / "farm.json", tmp_path / "alone"
    assert exit_code(["submit", str(sequence), "--openjd", str(template), "--frames", "1:3"]) == 0
    checked = openjd("check", template)
    assert checked.returncode == 0, checked.stdout + checked.stderr
    weft = Path(sys.executable).with_name("weft")
    done = openjd("run", template, "-p", f"Weft={weft}")
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-2000:]
    assert exit_code(["run", str(sequence), "--frames", "1:3", "--output", str(alone)]) == 0
    for frame in ("frame_0001", "frame_0002", "frame_0003"):
        farm, _ = read_exr(tmp_path / "job.out" / frame / "image.exr")
        one, _ = read_exr(alone / frame / "image.exr")
        for name, data in one.items():
            np.testing.assert_array_equal(data, farm[name], err_msg=name)
