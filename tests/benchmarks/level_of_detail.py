"""How far pictures with `detail_pixels` are from those in full detail, noise apart, and what they save.

`weft voxelize JOB`, then `python -m tests.benchmarks.level_of_detail JOB [--sizes 256:4 128:16 64:64]
[--pixels 0.5 1 2 4] [--picture OUT.png] [--volume FILE]`. Sizes are the picture's width and the samples per
pixel: half as many pixels are the same cloth from twice as far, near enough. Every picture is made twice with
independent seeds; a mean product of two independent differences has no share of the noise.
"""

from __future__ import annotations

import argparse
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from weft.pipeline.config import JobConfig
from weft.pipeline.job import Job, load_job
from weft.pipeline.picture_volume import picture_volume
from weft.pipeline.stages import media_scattering, scattering_by_medium
from weft.renderer.image import write_preview
from weft.renderer.render import RenderResult, run

BLOCK = 8
"""Pixels along the edge of the squares whose means are compared too."""


@dataclass(frozen=True)
class Pair:
    """One picture with two independent seeds."""

    one: RenderResult
    two: RenderResult
    cpu_seconds: float
    """Of tracing both."""
    setup_cpu_seconds: float
    """Of a picture with one sample: reading, building the pool, compiling from the cache."""

    @property
    def mean(self) -> np.ndarray:
        return (self.one.radiance.astype(float) + self.two.radiance) / 2

    @property
    def mean_variance(self) -> float:
        """Of the mean over picture and colors."""
        parts = [result.layers[f"variance.{c}"] for result in (self.one, self.two) for c in "RGB"]
        return sum(float(part.sum(dtype=float)) for part in parts) / (2 * self.one.radiance.size) ** 2 * 3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("job", type=Path)
    parser.add_argument("--sizes", nargs="+", default=["256:4", "128:16", "64:64"])
    parser.add_argument("--pixels", nargs="+", type=float, default=[0.5, 1.0, 2.0, 4.0])
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--volume", type=Path)
    parser.add_argument("--set", dest="overrides", action="append", default=[])
    args = parser.parse_args()
    overrides = [*args.overrides, f"render.detail_pixels={args.pixels[0]}"]
    job = load_job(args.job, overrides, model=JobConfig)
    volume = args.volume or job.table("render").volume or job.output / "volume.vdb"
    heads = ["wide", "detail_pixels", "fiber in voxels of", "mean", "per pixel", "8 x 8", "device"]
    print(f"| {' | '.join([*heads, 'setup', 'tracing'])} |")
    print("|---|---|---|---|---|---|---|---|---|")
    for text in args.sizes:
        rows = compare(job, volume, *(int(number) for number in text.split(":")), args.pixels)
        if args.picture is not None:
            draw(args.picture.with_stem(f"{args.picture.stem}_{text.split(':')[0]}"), rows)


def compare(job: Job, path: Path, width: int, samples: int, choices: list[float]) -> list[Pair]:
    """Those pictures that differ in what they are drawn from."""
    rows = [pair(Shot(job, path, width, None), samples)]
    full = rows[0]
    print(f"| {width} | full |{levels_of(full.one)} | | | | {mib(full):.1f} MiB | 1 | 1 |", flush=True)
    for pixels in choices:
        shot = Shot(job, path, width, pixels)
        drawn = shot.taken(1, 0)
        if not any(share.brick_count for share in drawn.statistics.detail[1:]):
            continue  # all in full detail
        if levels_of(drawn) in [levels_of(row.one) for row in rows]:
            continue
        other = pair(shot, samples)
        mean, error = mean_difference(full, other)
        single, block = (rms_difference(full, other, size) for size in (1, BLOCK))
        print(
            f"| {width} | {pixels:g} |{levels_of(other.one)} | {mean:+.2%} ± {error:.2%} | {single} "
            f"| {block} | {mib(other) / mib(full):.3f} "
            f"| {other.setup_cpu_seconds / full.setup_cpu_seconds:.2f} "
            f"| {other.cpu_seconds / full.cpu_seconds:.2f} |",
            flush=True,
        )
        rows.append(other)
    return rows


class Shot:
    """A job's picture of some width, at some level of detail."""

    def __init__(self, job: Job, path: Path, width: int, pixels: float | None) -> None:
        table = job.table("render")
        height = round(width * table.resolution[1] / table.resolution[0])
        update = {"resolution": (width, height), "crop": None, "detail_pixels": pixels, "noise": None}
        self.config = table.model_copy(update=update | {"time_s": None})
        self.volume = picture_volume(job, path)
        self.lobes = media_scattering(job, scattering_by_medium(job), self.volume)

    def taken(self, samples: int, seed: int) -> RenderResult:
        config = self.config.model_copy(update={"samples_per_pixel": samples, "seed": seed})
        return run(config, self.volume, self.lobes)


def pair(shot: Shot, samples: int) -> Pair:
    shot.taken(1, 0)  # warms the shader cache
    results, seconds = [], []
    for seed, count in ((0, 1), (1, samples), (2, samples)):
        before = os.times()
        results.append(shot.taken(count, seed))
        after = os.times()
        seconds.append(after.user + after.system - before.user - before.system)
    return Pair(results[1], results[2], sum(seconds[1:]) - 2 * seconds[0], seconds[0])


def levels_of(picture: RenderResult) -> str:
    shares = [share for share in picture.statistics.detail if share.brick_count]
    return ",".join(f" {share.voxel_size_mm:g} mm: {share.fiber_share:.0%}" for share in shares)


def mib(drawn: Pair) -> float:
    return drawn.one.statistics.device_bytes / 2**20


def mean_difference(full: Pair, other: Pair) -> tuple[float, float]:
    """Of the mean, relative, and its standard error."""
    mean = full.mean.mean()
    error = np.sqrt(full.mean_variance + other.mean_variance) / mean
    return float(other.mean.mean() / mean - 1), float(error)


def rms_difference(full: Pair, other: Pair, size: int) -> str:
    """Root mean square of the difference of squares of pixels, relative to the mean, noise apart."""
    one, two = (
        squares(b.radiance.astype(float) - a.radiance, size)
        for a, b in ((full.one, other.one), (full.two, other.two))
    )
    product = (one * two).mean(axis=-1)
    square, error = product.mean(), product.std() / np.sqrt(product.size)
    mean = full.mean.mean()
    rms = np.sqrt(max(square, 0.0))
    if rms == 0 or error > square:
        return f"< {np.sqrt(square.clip(0) + 2 * error) / mean:.1%}"
    return f"{rms / mean:.1%} ± {error / (2 * rms) / mean:.1%}"


def squares(values: np.ndarray, size: int) -> np.ndarray:
    """Means over squares of pixels."""
    rows, columns = (n // size for n in values.shape[:2])
    kept = values[: rows * size, : columns * size]
    return kept.reshape(rows, size, columns, size, -1).mean(axis=(1, 3))


def draw(path: Path, rows: list[Pair]) -> None:
    """Full detail, then above each choice and below how it differs over 4 x 4 pixels (gray: not at all)."""
    full = rows[0].mean
    scale = max(1, 256 // full.shape[1])
    shown = [larger(pair.mean, scale) for pair in rows]
    mean = full.mean()
    differences = [
        larger(0.18 + 0.18 * squares(pair.mean - full, 4) / mean, 4 * scale)[: shown[0].shape[0]]
        for pair in rows
    ]
    picture = np.concatenate([np.concatenate(shown, axis=1), np.concatenate(differences, axis=1)])
    write_preview(path, np.clip(picture, 0, None).astype(np.float32), exposure=0.0)


def larger(picture: np.ndarray, scale: int) -> np.ndarray:
    return np.kron(picture, np.ones((scale, scale, 1)))


if __name__ == "__main__":
    main()
