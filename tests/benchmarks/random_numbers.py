"""Error and CPU time of pictures by kind of random numbers, at the same samples.

    python -m tests.benchmarks.random_numbers [samples] [seeds]

Errors are those between pictures of different seeds (the layer `variance` knows nothing of sequences whose
samples avoid each other). Interleaved runs of one process, so of times only ratios count.
"""

from __future__ import annotations

import sys
import time

import numpy as np

from tests.benchmarks.trackers import yarns
from tests.renderer.test_transport import TABLE
from weft.renderer.config import RANDOM_KINDS, DirectionalLight, RenderConfig, StudioLight
from weft.renderer.render import run

SCENES = {
    "directional, one scattering": {"lights": [DirectionalLight(direction=(1, 2, 1))], "max_bounces": 1},
    "studio, one scattering": {"lights": [StudioLight()], "max_bounces": 1},
    "studio, all scatterings": {"lights": [StudioLight()]},
}


def report(samples: int, seeds: int) -> None:
    volume = yarns(64)
    print("| scene | random numbers | error², pcg4d 1 | CPU time | error² x time |")
    print("|---|---|---|---|---|")
    for name, scene in SCENES.items():
        pictures: dict[str, list[np.ndarray]] = {kind: [] for kind in RANDOM_KINDS}
        seconds = dict.fromkeys(RANDOM_KINDS, 0.0)
        for seed in range(seeds + 1):
            for kind, found in pictures.items():
                config = RenderConfig(
                    resolution=(64, 64), samples_per_pixel=samples, seed=seed, rng=kind, **scene
                )
                started = time.process_time()
                picture = run(config, volume, {"fiber": TABLE["reference"]}).radiance
                if seed:  # the first run compiles
                    found.append(picture)
                    seconds[kind] += time.process_time() - started
        errors = {kind: np.var(np.stack(found), axis=0, ddof=1).mean() for kind, found in pictures.items()}
        for kind in RANDOM_KINDS:
            error, cost = errors[kind] / errors["pcg4d"], seconds[kind] / seconds["pcg4d"]
            print(f"| {name} | {kind} | {error:.2f} | {cost:.2f} | {error * cost:.2f} |", flush=True)


if __name__ == "__main__":
    numbers = [int(text) for text in sys.argv[1:]] + [16, 12][len(sys.argv) - 1 :]
    report(numbers[0], numbers[1])
