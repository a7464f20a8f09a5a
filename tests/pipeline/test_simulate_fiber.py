"""`weft simulate-fiber`: what it writes, and what it says to mistakes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from weft.fiber_model.optics.light_transport import run
from weft.fiber_model.optics.materials import MATERIALS, material_optics
from weft.files.errors import InputError
from weft.fitting.measurement_file import load_measurements
from weft.pipeline.cli import exit_code
from weft.pipeline.simulate_fiber import as_measurements, load_simulation

FEW = ("--set", "paths=2000", "--set", "theta_i_deg=[0, 40]")


def test_the_file_holds_the_histogram(tmp_path: Path) -> None:
    out = tmp_path / "cotton.npz"
    assert exit_code(["simulate-fiber", "cotton", "--out", str(out), "--shape", "ellipse", *FEW]) == 0
    written = load_measurements(out)
    result = run(material_optics("cotton", "ellipse", paths=2000, theta_i_deg=(0, 40)))
    shape = result.phase_function().shape
    assert np.array_equal(written.values.reshape(shape), result.phase_function())
    assert (written.quantity, written.scale_known, written.channels) == (
        "phase_function",
        True,
        ("r", "g", "b"),
    )
    assert written.theta_i.reshape(shape[:3])[:, 3, 5] == pytest.approx(np.radians([0, 40]))
    assert np.array_equal(written.theta_o.reshape(shape[:3])[1, :, 2], result.bins.theta)
    assert np.array_equal(written.phi_o.reshape(shape[:3])[1, 4], result.bins.phi)
    assert "cotton: kind ellipse" in written.source


def test_energy_is_the_sum_over_the_sphere() -> None:
    """Rows times their bins' solid angles: what a reader of the file can check."""
    job = load_simulation("polyester", overrides=("paths=4000", "theta_i_deg=[30]", "absorption_per_mm=0"))
    result = run(job)
    rows = as_measurements(result, job).values.reshape(*result.bins.shape, 3)
    energy = (rows * result.bins.solid_angles[..., None]).sum(axis=(0, 1))
    assert energy == pytest.approx(result.albedo()[0][0], rel=1e-12)


def test_sigma_covers_the_scatter_of_repeats() -> None:
    """Over 40 seeds, in bins with much light: the mean of sigma² against the variance, within 20 %.

    The mean ratio of 30 bins and more has a standard error of sqrt(2 / 39 / 30) = 4 %: 5 of them.
    """
    overrides = ("paths=20000", "theta_i_deg=[20]", "theta_bin_deg=10", "phi_bin_deg=30")
    jobs = [load_simulation("wool", overrides=(*overrides, f"seed={seed}")) for seed in range(40)]
    repeats = [as_measurements(run(job), job) for job in jobs]
    values = np.stack([repeat.values[:, 1] for repeat in repeats])
    sigmas = np.stack([repeat.sigma[:, 1] for repeat in repeats if repeat.sigma is not None])
    much = values.mean(axis=0) > 10 * sigmas.mean(axis=0)
    assert much.sum() >= 30
    ratio = values.var(axis=0, ddof=1)[much] / (sigmas**2).mean(axis=0)[much]
    assert ratio.mean() == pytest.approx(1, abs=0.2)


def test_a_job_lies_over_its_material(tmp_path: Path) -> None:
    path = tmp_path / "job.toml"
    path.write_text(
        'material = "cotton"\npaths = 10\n[cross_section]\nkind = "circle"\nradius_mm = 0.01\n',
        encoding="utf-8",
    )
    job = load_simulation(str(path), overrides=("seed=7",))
    assert (job.paths, job.seed, job.cross_section.kind) == (10, 7, "circle")
    assert job.roughness == MATERIALS["cotton"].roughness


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('material = "cotn"\n', "job.toml:1: there is no fiber material 'cotn'. Known: cotton"),
        (
            'material = "wool"\nshape = "kidney"\n',
            "wool has no cross-section 'kidney'. Known: circle, ellipse",
        ),
        ('shape = "kidney"\n', "job.toml:1: shape: goes with a material"),
        ('material = "wool"\npahts = 3\n', "job.toml:2: pahts: unknown key; did you mean 'paths'?"),
        ('material = "wool"\ntheta_bin_deg = 7\n', "theta_bin_deg must divide 90"),
        (
            'material = "wool"\n[cross_section]\nkind = "polygon"\nvertices_mm = [[0,0],[1,1],[1,0],[0,1]]\n',
            "cross_section.vertices_mm: the sides cross",
        ),
    ],
)
def test_mistakes_are_one_line_and_leave_no_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, message: str
) -> None:
    job = tmp_path / "job.toml"
    job.write_text(text, encoding="utf-8")
    assert exit_code(["simulate-fiber", str(job), "--out", str(tmp_path / "x.npz"), "--set", "seed=1"]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
    assert list(tmp_path.iterdir()) == [job]


def test_a_suffix_that_cannot_be_written_is_refused_before_the_work(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written"):
        list(_simulate_to(tmp_path / "x.txt"))


def _simulate_to(out: Path) -> list[str]:
    from weft.pipeline.progress import reporter
    from weft.pipeline.simulate_fiber import simulate_fiber

    many = ("paths=2000000000",)
    return list(simulate_fiber("wool", out, shape=None, overrides=many, report=reporter("plain")))
