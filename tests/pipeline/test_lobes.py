"""`weft scattering`: what it takes, what it says, and that it draws."""

from __future__ import annotations

import json

import numpy as np
import pytest
from PIL import Image

from weft.fiber_model.scattering.config import LobesConfig
from weft.fiber_model.scattering.parameter_file import ScatteringParameterFile, save_parameters
from weft.files.errors import InputError
from weft.pipeline import lobe_pictures
from weft.pipeline.lobe_report import report_lines, weight_variance
from weft.pipeline.lobe_sources import lobes_of, lobes_of_all
from weft.pipeline.scattering_file import write_scattering

ACROSS = np.array([0.0, 1.0, 0.0])


@pytest.fixture(scope="module")
def presets():
    return lobes_of_all(["reference", "khungurn2015_silk"])


def test_a_preset_a_job_and_a_fit_are_taken(tmp_path, presets):
    job = tmp_path / "job.toml"
    job.write_text(
        '[yarns]\nkind = "nonsense"\n[scattering]\npreset = "reference"\n'
        "[scattering.by_type.weft]\nfresnel_tt = 0.5\n"
    )
    reference = presets["reference"]
    assert lobes_of(str(job)).keys() == {"job", "job: weft"}
    assert lobes_of(str(job))["job"] == reference

    fit = tmp_path / "fit.json"
    lobes = LobesConfig.from_parameters(reference)
    save_parameters(fit, ScatteringParameterFile(lobes, {"source": "a test", "method": "none"}))
    assert lobes_of(str(fit))["fit"].fresnel_tt == reference.fresnel_tt
    write_scattering(tmp_path / "scattering.json", {"*": reference, "warp": reference})
    assert lobes_of(str(tmp_path / "scattering.json")).keys() == {"scattering", "warp"}


def test_a_preset_s_own_file_is_taken(tmp_path, presets):
    from weft.pipeline.presets import CONFIGS

    file = CONFIGS / "presets" / "scattering" / "reference.toml"
    assert lobes_of(str(file)) == {"reference": presets["reference"]}


def test_the_same_name_twice_is_shown_twice():
    assert list(lobes_of_all(["reference", "reference"])) == ["reference", "reference (2)"]


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["referense"], "no scattering preset 'referense'; did you mean 'reference'?"),
        (["there_is.json"], "there_is.json: cannot be read"),
        (["there_is.toml"], "there_is.toml: cannot be read"),
        (["reference"] * 7, "7 parameter sets; one picture shows 1 to 6"),
    ],
)
def test_mistakes_are_one_clear_line(names, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError) as caught:
        lobes_of_all(names)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_other_json_is_refused(tmp_path):
    (tmp_path / "x.json").write_text(json.dumps({"format": "x"}))
    with pytest.raises(InputError, match="no scattering parameters"):
        lobes_of(str(tmp_path / "x.json"))


def test_says_albedo_and_variance(presets):
    """At normal incidence silk reflects F_R and lets (1 - F_R) C_TT through; gray weights are even."""
    lines = list(report_lines(presets))
    silk = next(i for i, line in enumerate(lines) if line.startswith("khungurn2015_silk"))
    red = next(line for line in lines[silk:] if "albedo r" in line)
    assert float(red.split()[2]) == pytest.approx(0.745 + 0.255 * 0.62, abs=5e-5)
    gray = next(line for line in lines[:silk] if "variance" in line)
    assert gray.split()[1:] == ["0"] * 8
    colored = next(line for line in lines[silk:] if "variance" in line)
    assert all(float(cell) > 0 for cell in colored.split()[1:])


def test_variance_is_that_of_two_lobes(presets):
    """At normal incidence the lobes of silk hardly overlap around the fiber: weights are a_k / chance_k.

    They do overlap a little, which can only even them out: the variance lies below that of two apart.
    """
    reflected, through = np.array([0.745, 0.008, 0.07]), np.array([0.255, 0.992, 0.93])
    energies = np.stack([reflected, through * [0.62, 0.553, 0.562]])
    chance = energies.max(axis=1) / energies.max(axis=1).sum()
    apart = (energies**2 / chance[:, None]).sum(axis=0) / energies.sum(axis=0) ** 2 - 1
    found = weight_variance(presets["khungurn2015_silk"], ACROSS)
    assert 0.5 * apart.max() < found < 1.05 * apart.max()


def test_draws_a_png_that_is_not_empty(tmp_path, presets, monkeypatch):
    monkeypatch.setattr(lobe_pictures, "SURFACE_POINTS", (31, 31))
    lobe_pictures.draw_lobes(presets, tmp_path / "lobes.png")
    with Image.open(tmp_path / "lobes.png") as picture:
        pixels = np.asarray(picture.convert("RGB"))
    assert (pixels < 200).any(axis=-1).mean() > 0.02
    for bad, message in (
        (tmp_path / "lobes.gif", "is a .png file"),
        (tmp_path / "a.png", "between -90 and 90"),
    ):
        with pytest.raises(InputError, match=message):
            lobe_pictures.draw_lobes(presets, bad, theta_deg=95.0 if bad.name == "a.png" else 45.0)
    assert [file.name for file in tmp_path.iterdir()] == ["lobes.png"]
