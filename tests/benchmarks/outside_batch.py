"""What the thesis' homogeneous medium outside of a batch does to a picture: bias apart from noise.

`weft run tests/jobs/pool_swatch.toml`, then
`python -m tests.benchmarks.outside_batch tests/jobs/pool_swatch.out/volume.vdb 192 16 5 difference.png`:
resolution, samples per pixel, seeds. Both ways use the same seeds, so that paths that stay in their batch
cancel, and the standard errors of the differences come from how they differ between seeds.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from weft.renderer.brick_file import open_brick_file
from weft.renderer.image import write_preview
from weft.renderer.render import run

from .out_of_core import SHARE, lobes_beside, means, view

TILE = 8
"""Pixels along the edge of a tile."""
ZOOM = 3
FULL_SCALE = 0.3
"""Relative difference that is drawn in full color."""


def main(path: Path, resolution: int, samples: int, seeds: int, picture: Path | None) -> None:
    bricks, lobes = open_brick_file(path), lobes_beside(path)
    pool = {
        "brick_pool_mb": bricks.brick_count * 2048 / 2**20 / SHARE,
        "outside_batch": "homogeneous",
    }
    exact, biased = [], []
    for seed in range(1, seeds + 1):
        config = view(resolution, samples).model_copy(update={"seed": seed})
        exact.append(run(config, bricks, lobes).radiance.astype(np.float64))
        biased.append(run(config.model_copy(update=pool), bricks, lobes).radiance.astype(np.float64))
    report(np.array(exact), np.array(biased), picture)


def report(exact: np.ndarray, biased: np.ndarray, picture: Path | None) -> None:
    """Of pictures of several seeds, shape [seeds, height, width, 3]."""
    truth = exact.mean()
    whole = (biased - exact).mean(axis=(1, 2, 3)) / truth
    print(f"mean of the picture: {whole.mean() * 100:+.2f} +- {error(whole) * 100:.2f} %")
    light = np.array([means(image, TILE).mean(axis=-1) for image in exact]).mean(axis=0)
    tiles = np.array([means(b - e, TILE).mean(axis=-1) for b, e in zip(biased, exact, strict=True)])
    shift, noise = tiles.mean(axis=0), error(tiles)
    lit = light > 0.05 * light.mean()
    square = (shift**2 - noise**2)[lit].mean()
    rest, bias = rms(noise[lit]) / truth * 100, np.sqrt(max(square, 0)) / truth * 100
    print(
        f"{lit.sum()} tiles of {TILE} x {TILE}: bias {bias:.2f} % of the mean, rms; their noise {rest:.2f} %"
    )
    beyond = (np.abs(shift) > 5 * noise)[lit].mean() * 100
    print(f"tiles beyond 5 standard errors: {beyond:.0f} %; by chance {chance(len(tiles)) * 100:.1f} %")
    percentiles = ", ".join(
        f"{v * 100:+.1f}" for v in np.percentile(shift[lit] / light[lit], [1, 10, 50, 90, 99])
    )
    print(f"relative bias of tiles, percentiles 1, 10, 50, 90, 99: {percentiles} %")
    if picture is not None:
        draw(picture, exact.mean(axis=0), biased.mean(axis=0))


def draw(path: Path, exact: np.ndarray, biased: np.ndarray) -> None:
    """Exact, homogeneous, and their difference: red where homogeneous is too bright, blue too dark."""
    light = np.repeat(np.repeat(means(exact, TILE // 2).mean(axis=-1), TILE // 2, 0), TILE // 2, 1)
    shift = np.repeat(np.repeat(means(biased - exact, TILE // 2).mean(axis=-1), TILE // 2, 0), TILE // 2, 1)
    amount = np.clip(shift / np.maximum(light, 0.05 * light.mean()) / FULL_SCALE, -1, 1)[..., None]
    colors = np.where(amount > 0, (0.8, 0.05, 0.03), (0.03, 0.12, 0.8))
    shown = (1 - np.abs(amount)) * 0.75 + np.abs(amount) * colors
    size = len(shown)
    gap = np.ones((size, 4, 3))
    panels = [exact[:size, :size], gap, biased[:size, :size], gap, shown]
    strip = np.concatenate(panels, axis=1).astype(np.float32)
    write_preview(path, np.kron(strip, np.ones((ZOOM, ZOOM, 1), np.float32)), exposure=0.0)


def error(values: np.ndarray) -> np.ndarray:
    """Standard error of the mean over the first axis."""
    return values.std(axis=0, ddof=1) / np.sqrt(len(values))


def chance(seeds: int) -> float:
    """That so many differences without bias have a mean of more than 5 standard errors (Student)."""
    from scipy.stats import t

    return float(2 * t.sf(5, seeds - 1))


def rms(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).mean()))


if __name__ == "__main__":
    target = Path(sys.argv[5]) if len(sys.argv) > 5 else None
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]), target)
