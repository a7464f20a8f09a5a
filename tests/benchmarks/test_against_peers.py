"""Speed against Mitsuba 3 and Blender's Cycles on one scene, in one run, per CPU second at equal
variance.

`python -m pytest tests/benchmarks/test_against_peers.py -s -m benchmark` (some 2 minutes of an idle
core) prints ratios and asserts nothing about them. A cloth-like volume of 256^3 voxels, isotropic,
albedo 0.95, light sampling and MIS, in uniform light. Needs for all of it: Mitsuba 3.9; LLVM for
its llvm_ad_rgb (Debian: libllvm19; where it is unpacked elsewhere, DRJIT_LIBLLVM_PATH); an
interpreter with bpy 5 (WEFT_BPY_PYTHON). What is absent is skipped.

Variance is that between independent pictures, for all alike, and so counts what better spread
samples gain. Cycles interpolates voxels; the others take the nearest. Its null scattering is not
unbiased (a white volume in white light comes out at 1.03 here), so it is measured with its ray
marching too (1.00).
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from tests.peers.speed_images import SpeedJob
from tests.peers.weft_volume import dense_volume
from weft.renderer.image import read_rgb
from weft.voxelize.vdb import write_volume

pytestmark = pytest.mark.benchmark

CHECKOUT = Path(__file__).resolve().parents[2]
CYCLES = CHECKOUT / "tests" / "peers" / "cycles_volume.py"
BPY_PYTHON = "WEFT_BPY_PYTHON"
JOB = SpeedJob()


@dataclass(frozen=True)
class Measured:
    """What one program made of a job."""

    images: np.ndarray
    """Independent pictures, float64, shape [runs, height, width]."""
    seconds: float
    """CPU seconds for all of them."""
    samples: int

    @property
    def paths_per_second(self) -> float:
        return self.images.size * self.samples / self.seconds

    @property
    def path_variance(self) -> float:
        """Variance of one path, averaged over the pixels."""
        return float(self.images.var(axis=0, ddof=1).mean()) * self.samples

    @property
    def efficiency(self) -> float:
        """1 / (variance x CPU time)."""
        return self.paths_per_second / self.path_variance

    @property
    def mean(self) -> tuple[float, float]:
        """Of the picture, and its standard error."""
        error = np.sqrt(self.images.var(axis=0, ddof=1).sum() / len(self.images)) / self.images[0].size
        return float(self.images.mean()), float(error)

    def line(self, name: str) -> str:
        mean, error = self.mean
        return (
            f"  {name:28s} {self.paths_per_second:9,.0f} paths per CPU s   variance {self.path_variance:.4f}"
            f"   mean {mean:.4f} +- {error:.4f}"
        )


def measure(program: str, folder: Path, job: SpeedJob) -> Measured:
    """By `tests.peers.speed_images`, in a process of its own."""
    out = folder / f"{program}.npz"
    command = [sys.executable, "-m", "tests.peers.speed_images", program, str(out), json.dumps(asdict(job))]
    subprocess.run(command, check=True, cwd=CHECKOUT)
    with np.load(out) as found:
        return Measured(found["images"], float(found["seconds"]), job.samples)


def measure_cycles(folder: Path, job: SpeedJob, *, march: bool) -> Measured:
    """By the interpreter with bpy."""
    scene = job.scene()
    write_volume(folder / "volume.vdb", dense_volume(scene))
    wish = {
        "volume": str(folder / "volume.vdb"),
        "camera": scene.camera_position,
        "target": scene.camera_target,
        "fov": np.radians(scene.fov_deg),
        "albedo": scene.albedo,
        "resolution": job.resolution,
        "samples": job.samples,
        "runs": job.runs,
        "march": march,
        "out": str(folder),
    }
    (folder / "job.json").write_text(json.dumps(wish))
    subprocess.run(
        [os.environ[BPY_PYTHON], str(CYCLES), str(folder / "job.json")], check=True, capture_output=True
    )
    seconds = json.loads((folder / "seconds.json").read_text())
    pictures = [read_rgb(folder / f"run_{n}.exr").mean(-1, dtype=np.float64) for n in range(1, job.runs + 1)]
    return Measured(np.stack(pictures), sum(seconds[1:]), job.samples)


@pytest.fixture(scope="module")
def weft(tmp_path_factory):
    """As it is, with samples spread by Sobol, and with light sampling at every scattering."""
    folder = tmp_path_factory.mktemp("weft")
    job = replace(JOB, samples=128)
    jobs = {"weft": job, "weft, sobol": replace(job, rng="sobol")}
    jobs |= {"weft, both_plain": replace(job, sampling="both_plain")}
    found = {name: measure("weft", folder, job) for name, job in jobs.items()}
    print(f"\n{job.voxels}^3 voxels, {job.resolution}^2 pixels, load {os.getloadavg()[0]:.1f}")
    for name, measured in found.items():
        print(measured.line(name))
    return found


def compare(name: str, weft: dict[str, Measured], peer: Measured) -> None:
    print("\n" + peer.line(name))
    for label, ours in weft.items():
        (a, error_a), (b, error_b) = ours.mean, peer.mean
        z = (a - b) / np.hypot(error_a, error_b)
        print(
            f"    {label}: {ours.paths_per_second / peer.paths_per_second:.1f} in paths, "
            f"{ours.efficiency / peer.efficiency:.1f} at equal variance; Welch z of the means {z:+.1f}"
        )


@pytest.mark.parametrize("variant", ["scalar_rgb", "llvm_ad_rgb"])
def test_mitsuba(weft, variant, tmp_path):
    mitsuba = pytest.importorskip("mitsuba", reason="Mitsuba 3 is not installed")
    try:
        mitsuba.set_variant(variant)
        mitsuba.Float(0)
    except Exception as error:
        pytest.skip(f"Mitsuba has no {variant}: {error}")
    compare(f"Mitsuba {mitsuba.__version__} {variant}", weft, measure(variant, tmp_path, JOB))


@pytest.mark.parametrize("march", [False, True], ids=["null", "march"])
def test_cycles(weft, march, tmp_path):
    if not os.environ.get(BPY_PYTHON):
        pytest.skip(f"{BPY_PYTHON} names no interpreter with bpy")
    name = "Cycles, ray marching" if march else "Cycles, null scattering"
    compare(name, weft, measure_cycles(tmp_path, JOB, march=march))
