"""Simple phase functions and media beside the fibers, from a job file to the picture."""

from __future__ import annotations

import json

import numpy as np
import pytest

from weft.pipeline.cli import exit_code
from weft.pipeline.scattering_file import read_scattering, write_scattering
from weft.renderer.image import read_rgb
from weft.renderer.simple_phases import HenyeyGreensteinPhase, IsotropicPhase, SggxPhase

from .test_cli import KNIT, job

FOG = """
[[render.media]]
kind = "homogeneous"
extinction_per_mm = [0.05, 0.1, 0.4]
bound = { kind = "ball", radius_mm = 20 }
scattering = { kind = "henyey_greenstein", g = 0.4, albedo = [0.9, 0.8, 0.5] }

[[render.media]]
kind = "homogeneous"
extinction_per_mm = 0.02
bound = { kind = "box", lower_mm = [-30, -30, -30], upper_mm = [30, 0, 30] }
"""


def without_scattering(text):
    start = text.index("[scattering]")
    return text[:start] + text[text.index("[", start + 1) :]


@pytest.mark.gl
def test_a_job_with_colored_fog_around_its_knit(tmp_path):
    assert exit_code(["run", str(job(tmp_path, KNIT + FOG))]) == 0
    picture = read_rgb(tmp_path / "job.out" / "image.exr")
    assert np.isfinite(picture).all()
    assert np.ptp(picture.mean(axis=(0, 1))) > 0.01
    record = json.loads((tmp_path / "job.out" / "image.run.json").read_text())
    assert record["report"]["broken_samples"] == 0
    assert record["config"]["render"]["media"][0]["bound"] == {
        "kind": "ball",
        "position_mm": [0.0, 0.0, 0.0],
        "radius_mm": 20.0,
    }


@pytest.mark.gl
def test_a_job_whose_grid_scatters_as_henyey_and_greenstein(tmp_path):
    """What [scattering] says stands in scattering.json, and the picture is made of it."""
    text = without_scattering(KNIT) + '\n[scattering]\nkind = "henyey_greenstein"\ng = 0.6\nalbedo = 0.5\n'
    assert exit_code(["run", str(job(tmp_path, text))]) == 0
    assert read_rgb(tmp_path / "job.out" / "image.exr").max() > 0
    document = json.loads((tmp_path / "job.out" / "scattering.json").read_text())
    assert document["media"]["*"] == {
        "kind": "henyey_greenstein",
        "g": 0.6,
        "albedo": [0.5, 0.5, 0.5],
        "emission": [0.0, 0.0, 0.0],
    }


@pytest.mark.parametrize(
    "one", [IsotropicPhase((0.1, 0.2, 0.3), (1.0, 2.0, 3.0)), HenyeyGreensteinPhase(-0.3), SggxPhase(0.4)]
)
def test_simple_phases_read_back_as_they_were_written(tmp_path, one):
    write_scattering(tmp_path / "s.json", {"*": one})
    assert read_scattering(tmp_path / "s.json") == {"*": one}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('kind = "isotropc"', "did you mean 'isotropic'?"),
        ('kind = "henyey_greenstein"', "scattering.g: is missing"),
        ('kind = "henyey_greenstein"\ng = 1.5', "scattering.g: found 1.5; must be less than 1"),
        ('kind = "isotropic"\nalbedo = 2', "scattering.albedo"),
        ('kind = "sggx"\nroughness = 0', "scattering.roughness: found 0; must be greater than 0"),
    ],
)
def test_mistakes_are_told_in_a_line(tmp_path, capsys, text, message):
    path = job(tmp_path, without_scattering(KNIT) + f"\n[scattering]\n{text}\n")
    assert exit_code(["check", str(path)]) == 2
    assert message in capsys.readouterr().err


def test_a_medium_that_is_no_medium_is_refused_with_its_key(tmp_path, capsys):
    path = job(tmp_path, KNIT + FOG.replace('"ball", radius_mm = 20', '"ball", radius_mm = -1'))
    assert exit_code(["check", str(path)]) == 2
    assert "render.media.1.bound.radius_mm" in capsys.readouterr().err.replace("[0]", ".1")
