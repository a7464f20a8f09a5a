"""Our tracer of fibers, which judges the volume, against Mitsuba 3: `bsplinecurve` with the same lobes."""

from __future__ import annotations

import numpy as np
import pytest

from tests.peers.fiber_scenes import GRAY
from tests.peers.fiber_tracer import FiberScene, FiberTracer
from tests.peers.mitsuba_fibers import (
    SplineFibers,
    View,
    light_of_three,
    render_fibers,
    straight_fibers,
    wavy_fibers,
)

pytestmark = pytest.mark.proof

ERROR_PROBABILITY = 1e-4
"""Chance that a scene fails although both are right (two-sided, Sidak over lights and tiles)."""
RESOLUTION, TILE, SAMPLES = 24, 8, 200
ABOVE = View(0.1, RESOLUTION)
SLANTED = View(0.1, RESOLUTION, (0.8, 0.0, 0.6))


def traced_tiles(scene: FiberScene, view: View) -> tuple[np.ndarray, np.ndarray]:
    """Means, shape [tiles, 3 lights], and their variances, each pixel a stratum; tiles row by row."""
    rng = np.random.default_rng(7)
    origin, direction = view.rays(SAMPLES, rng)
    brought, _, _ = FiberTracer(scene).radiance(origin, direction, GRAY, light_of_three, rng)
    pixels = brought.reshape(RESOLUTION, RESOLUTION, SAMPLES, 3)
    return tiled(pixels.mean(axis=2)), tiled(pixels.var(axis=2, ddof=1) / SAMPLES) / TILE**2


def tiled(picture: np.ndarray) -> np.ndarray:
    """Means of square tiles, [height, width, lights] to [tiles, lights]."""
    side = RESOLUTION // TILE
    return picture.reshape(side, TILE, side, TILE, -1).mean(axis=(1, 3)).reshape(side * side, -1)


@pytest.mark.parametrize(
    ("name", "fibers", "view", "runs"),
    [
        ("thin", straight_fibers(30), ABOVE, 100),
        ("dense", straight_fibers(200, apart=0.016), ABOVE, 40),
        ("wavy, overlapping, slanted view", wavy_fibers(100), SLANTED, 40),
    ],
)
def test_fibers_look_as_in_mitsuba(tmp_path, name: str, fibers: SplineFibers, view: View, runs: int):
    """Under uniform light, light where z > 0 and where x > 0: all of the picture, and its tiles."""
    from scipy import stats

    ours, variance = traced_tiles(fibers.pieces(), view)
    pictures = render_fibers(fibers, GRAY, view, tmp_path, runs=runs)
    tiles = np.stack([tiled(picture) for picture in pictures])
    whole = tiles.mean(axis=1, keepdims=True)
    theirs = np.concatenate([whole, tiles], axis=1)
    ours = np.concatenate([ours.mean(axis=0, keepdims=True), ours])
    variance = np.concatenate([variance.mean(axis=0, keepdims=True) / len(variance), variance])
    error = np.sqrt(theirs.var(axis=0, ddof=1) / runs + variance)
    t = (ours - theirs.mean(axis=0)) / error
    limit = stats.t.isf((1 - (1 - ERROR_PROBABILITY) ** (1 / t.size)) / 2, runs - 1)
    print(
        f"\n{name}: traced {ours[0].round(4)}, Mitsuba {theirs.mean(axis=0)[0].round(4)}, "
        f"standard error of the difference {(100 * error[0] / ours[0]).round(2)} %, t {t[0].round(2)}, "
        f"largest of {t[1:].size} tiles {np.abs(t[1:]).max():.2f}, limit {limit:.2f}"
    )
    assert np.abs(t).max() < limit
