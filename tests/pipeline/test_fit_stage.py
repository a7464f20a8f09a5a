"""`weft fit` and its place in `weft run`."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.fitting.fit_cases import random_truth, synthetic
from weft.fitting.measurement_file import save_measurements
from weft.fitting.selection import take
from weft.pipeline.cli import exit_code

JOB = """
[fit]
measurements = "fiber.npz"
starts = 8
[scattering]
fit = "job.out/fit.json"
"""


@pytest.fixture
def job(tmp_path):
    save_measurements(synthetic(random_truth(np.random.default_rng(1)), seed=1), tmp_path / "fiber.npz")
    (tmp_path / "job.toml").write_text(JOB, encoding="utf-8")
    return tmp_path / "job.toml"


def test_run_fits_before_scattering_takes_the_result(job):
    assert exit_code(["run", str(job)]) == 0
    fitted = json.loads((job.parent / "job.out" / "fit.json").read_text())
    scattering = json.loads((job.parent / "job.out" / "scattering.json").read_text())
    beta = np.degrees(scattering["media"]["*"]["longitudinal_width_r"])
    assert beta == pytest.approx(fitted["scattering"]["longitudinal_width_r_deg"], rel=1e-12)


def test_the_same_job_writes_the_same_bytes(job):
    assert exit_code(["fit", str(job)]) == 0
    names = ("fit.json", "fit.md", "fit_slices.png", "fit_residuals.png")
    first = {name: (job.parent / "job.out" / name).read_bytes() for name in names}
    assert exit_code(["fit", str(job), "--force"]) == 0
    assert {name: (job.parent / "job.out" / name).read_bytes() for name in names} == first


def test_check_knows_that_the_fit_is_to_come(job, capsys):
    assert exit_code(["check", str(job)]) == 0
    assert "scattering: would run, after the fit" in capsys.readouterr().out
    job.write_text(JOB.replace("job.out/fit.json", "job.out/other.json"), encoding="utf-8")
    assert exit_code(["check", str(job)]) == 2
    assert "file not found" in capsys.readouterr().err


def test_check_finds_mistakes_beside_a_fit_to_come(job, capsys):
    job.write_text(JOB + "color_tt = 3\n", encoding="utf-8")
    assert exit_code(["check", str(job)]) == 2
    assert "job.toml:7: scattering.color_tt" in capsys.readouterr().err


def test_what_cannot_be_fitted_exits_2_with_the_reason(job, capsys):
    data = synthetic(random_truth(np.random.default_rng(1)), seed=1)
    save_measurements(take(data, np.arange(len(data)) < 5), job.parent / "fiber.npz")
    assert exit_code(["fit", str(job)]) == 2
    assert "cannot determine" in capsys.readouterr().err
    assert not (job.parent / "job.out" / "fit.json").exists()


def test_no_convergence_exits_2_with_the_reason(job, capsys, monkeypatch):
    monkeypatch.setattr("weft.fitting.solve.EDM_LIMIT", -1.0)
    assert exit_code(["fit", str(job)]) == 2
    assert "not converged" in capsys.readouterr().err
    assert not (job.parent / "job.out" / "fit.json").exists()
