"""A volume with all voxels on the device, with a pool of 1/16 of them, and with the thesis' stand-in.

`weft run tests/jobs/pool_swatch.toml`, then
`python -m tests.benchmarks.out_of_core tests/jobs/pool_swatch.out/volume.vdb 256 64`:
resolution and samples per pixel. All times are from one run; the first picture warms the shader cache.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import numpy as np

from weft.fiber_model.scattering.parameters import FiberScatteringParameters
from weft.pipeline.scattering_file import read_scattering
from weft.renderer.brick_file import open_brick_file
from weft.renderer.config import DirectionalLight, PerspectiveCamera, RenderConfig, StudioLight
from weft.renderer.render import RenderResult, run

SHARE = 16
SUN = DirectionalLight(direction=(-1, 0.7, 0.6), irradiance=(2.2, 2.1, 2.0), relative_to="camera")


def view(resolution: int, samples: int) -> RenderConfig:
    """The whole swatch, seen from a little above."""
    return RenderConfig(
        resolution=(resolution, resolution),
        samples_per_pixel=samples,
        camera=PerspectiveCamera(view_direction=(0.1, -0.25, 1.0), fov_deg=20),
        lights=(StudioLight(), SUN),
    )


def lobes_beside(volume: Path) -> dict[str, FiberScatteringParameters]:
    """The scattering that the job wrote beside its volume."""
    return {"yarn": next(iter(read_scattering(volume.with_name("scattering.json")).values()))}


def main(path: Path, resolution: int, samples: int) -> None:
    bricks, config, lobes = open_brick_file(path), view(resolution, samples), lobes_beside(path)
    pool = {"brick_pool_mb": bricks.brick_count * 2048 / 2**20 / SHARE}
    resident = {"brick_pool_mb": (bricks.brick_count - 1) * 2048 / 2**20}

    def render(name: str, **settings: object) -> tuple[RenderResult, float]:
        cpu, wall = os.times(), time.perf_counter()
        result = run(config.model_copy(update=settings), bricks, lobes)
        seconds, after = time.perf_counter() - wall, os.times()
        spent = after.user + after.system - cpu.user - cpu.system
        s = result.statistics
        uploads = s.brick_uploads / max(s.bricks_used, 1)
        print(f"{name}: {seconds:.1f} s, {spent:.1f} CPU s, {uploads:.2f} uploads per brick used")
        return result, spent

    render("warming up", samples_per_pixel=1)
    render("warming up", samples_per_pixel=1, **pool)
    exact, in_core = render("in core")
    for name, settings in (("pool of 1/16", pool), ("pool of all bricks but one", resident)):
        parked, spent = render(name, **settings)
        same = all(np.array_equal(layer, parked.layers[name]) for name, layer in exact.layers.items())
        print(f"  same bits: {same}; CPU time {spent / in_core:.2f} times that in core")
    _, spent = render("homogeneous", **pool, outside_batch="homogeneous")
    print(f"  CPU time {spent / in_core:.2f} times that in core")


def means(values: np.ndarray, size: int) -> np.ndarray:
    """Of squares of pixels."""
    n = len(values) // size
    return values[: n * size, : n * size].reshape(n, size, n, size, -1).mean(axis=(1, 3))


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
