"""A volume with all voxels on the device, with a pool of 1/16 of them, and with the thesis' stand-in.

`weft run tests/jobs/pool_swatch.toml`, then
`python -m tests.benchmarks.out_of_core tests/jobs/pool_swatch.out/volume.vdb 256 16 [difference.png]`:
resolution and samples per pixel. All times are from one run; the first picture warms the shader cache.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import numpy as np

from weft.pipeline.scattering_file import read_scattering
from weft.renderer.brick_file import open_brick_file
from weft.renderer.config import DirectionalLight, PerspectiveCamera, RenderConfig, StudioLight
from weft.renderer.image import write_preview
from weft.renderer.render import RenderResult, run

SHARE = 16
SUN = DirectionalLight(direction=(-1, 0.7, 0.6), irradiance=(2.2, 2.1, 2.0), relative_to="camera")


def main(path: Path, resolution: int, samples: int, picture: Path | None) -> None:
    config = RenderConfig(
        resolution=(resolution, resolution),
        samples_per_pixel=samples,
        camera=PerspectiveCamera(view_direction=(0.1, -0.25, 1.0), fov_deg=20),
        lights=(StudioLight(), SUN),
    )
    lobes = {"yarn": next(iter(read_scattering(path.with_name("scattering.json")).values()))}
    bricks = open_brick_file(path)
    pool = {"brick_pool_mb": bricks.brick_count * 2048 / 2**20 / SHARE}

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
    exact, in_core = render("in core")
    parked, spent = render("pool of 1/16", **pool)
    same = all(np.array_equal(layer, parked.layers[name]) for name, layer in exact.layers.items())
    print(f"  same bits: {same}; CPU time {spent / in_core:.2f} times that in core")
    biased, _ = render("homogeneous", **pool, outside_batch="homogeneous")
    report_bias(exact, biased, picture)


def report_bias(exact: RenderResult, biased: RenderResult, picture: Path | None) -> None:
    truth, other = exact.radiance.astype(np.float64), biased.radiance.astype(np.float64)
    noise = np.sqrt(sum(exact.layers[f"variance.{c}"].mean() for c in "RGB") / 3)
    mean = truth.mean()
    print(f"  mean {(other.mean() / mean - 1) * 100:+.2f} %; rms {rms(other - truth) / mean * 100:.1f} %,")
    print(f"  of which noise of two pictures at most {np.sqrt(2) * noise / mean * 100:.1f} %")
    blocks = [means(other - truth, size) for size in (1, 8)]
    print(f"  rms of 8 x 8 pixels {rms(blocks[1]) / mean * 100:.1f} %")
    if picture is not None:
        shown = np.clip(0.18 + 2.0 * np.kron(blocks[1], np.ones((8, 8, 1))) / mean * 0.18, 0, 1)
        write_preview(picture, np.concatenate([truth, other, shown], axis=1).astype(np.float32), exposure=0.0)


def means(values: np.ndarray, size: int) -> np.ndarray:
    """Of squares of pixels."""
    n = len(values) // size
    return values[: n * size, : n * size].reshape(n, size, n, size, -1).mean(axis=(1, 3))


def rms(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).mean()))


if __name__ == "__main__":
    target = Path(sys.argv[4]) if len(sys.argv) > 4 else None
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), target)
