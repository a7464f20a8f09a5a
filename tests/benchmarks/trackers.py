"""Variance x CPU time of every pair of estimators on fibers, and the bias of ray marching.

    python -m tests.benchmarks.trackers [volume.vdb] [samples] [repetitions]

Without a volume: yarns of 96^3 voxels. Interleaved runs of one process, so of times only ratios count.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tests.peers.scenes import twisted_yarns
from tests.peers.weft_volume import dense_volume
from tests.renderer.test_transport import TABLE
from weft.renderer.config import DirectionalLight, RenderConfig, StudioLight
from weft.renderer.render import run
from weft.voxelize.grid import FiberVolume

PAIRS = [
    ("exact", "exact"),
    ("exact", "ratio"),
    ("exact", "residual_ratio"),
    ("exact", "march"),
    ("delta", "exact"),
    ("delta", "ratio"),
    ("delta", "residual_ratio"),
    ("delta", "march"),
]
MARCH_STEPS = (0.25, 1.0, 2.0, 4.0)
"""In voxels, for the bias."""


@dataclass
class Cost:
    """Of one estimator, summed over repetitions."""

    means: list[float] = field(default_factory=list)
    variance: float = 0.0
    cpu_seconds: float = 0.0
    steps: int = 0
    paths: int = 0


def picture(volume: FiberVolume, samples: int, seed: int, **settings) -> tuple[float, float, float, int, int]:
    """Mean, its variance, CPU seconds, tracking steps and paths of one run."""
    config = RenderConfig(
        resolution=(96, 96),
        samples_per_pixel=samples,
        seed=seed,
        lights=[StudioLight(), DirectionalLight(direction=(1, 2, 1))],
        **settings,
    )
    scattering = dict.fromkeys(volume.media, TABLE["reference"])
    started = time.process_time()
    result = run(config, volume, scattering)
    seconds = time.process_time() - started
    variance = sum(float(result.layers[f"variance.{c}"].sum(dtype=np.float64)) for c in "RGB") / 9
    counted = result.statistics
    mean = float(result.radiance.mean(dtype=np.float64))
    return mean, variance / (96 * 96) ** 2, seconds, counted.tracking_steps, counted.paths


def measure(volume: FiberVolume, samples: int, repetitions: int) -> dict[tuple[str, str], Cost]:
    costs = {pair: Cost() for pair in PAIRS}
    for pair in PAIRS:
        picture(volume, 1, 0, tracking=pair[0], shadow_tracking=pair[1])  # compiles
    for repetition in range(repetitions):
        for pair, cost in costs.items():
            settings = {"tracking": pair[0], "shadow_tracking": pair[1]}
            mean, variance, seconds, steps, paths = picture(volume, samples, repetition + 1, **settings)
            cost.means.append(mean)
            cost.variance += variance
            cost.cpu_seconds += seconds
            cost.steps += steps
            cost.paths += paths
    return costs


def report(volume: FiberVolume, samples: int, repetitions: int) -> None:
    costs = measure(volume, samples, repetitions)
    best = costs["exact", "exact"]
    mean = np.mean(best.means)
    print("| flights | shadow rays | mean | variance | CPU time | steps per path | variance x time |")
    print("|---|---|---|---|---|---|---|")
    for (flights, shadows), cost in costs.items():
        off = np.mean(cost.means) / mean - 1
        error = np.sqrt(cost.variance + best.variance) / repetitions / mean
        ratios = cost.variance / best.variance, cost.cpu_seconds / best.cpu_seconds
        print(
            f"| {flights} | {shadows} | {off:+.2%} ± {error:.2%} | {ratios[0]:.2f} | {ratios[1]:.2f} | "
            f"{cost.steps / cost.paths:.0f} | {ratios[0] * ratios[1]:.2f} |"
        )
    for step in MARCH_STEPS:
        size = volume.voxel_size_mm
        settings = {"shadow_tracking": "march", "march_step_mm": step * size}
        many = [picture(volume, samples, 100 + i, **settings)[:2] for i in range(repetitions)]
        off = np.mean([m for m, _ in many]) / mean - 1
        error = np.sqrt(sum(v for _, v in many) + best.variance) / repetitions / mean
        print(f"ray marching by {step:g} voxels: mean {off:+.2%} ± {error:.2%}")


def yarns(voxels: int) -> FiberVolume:
    """Two twisted yarns in a block of so many voxels a side."""
    return dense_volume(twisted_yarns(voxels, peak_extinction=60.0, resolution=64, albedo=0.9))


def _volume(path: str | None) -> FiberVolume:
    if path is None:
        return yarns(96)
    from weft.voxelize.vdb import read_volume

    return read_volume(Path(path))


if __name__ == "__main__":
    given = sys.argv[1:]
    path = given.pop(0) if given and not given[0].isdigit() else None
    numbers = [int(text) for text in given] + [16, 3][len(given) :]
    report(_volume(path), numbers[0], numbers[1])
