"""Pictures of one scene by weft and by Mitsuba 3, and how far apart they are in standard errors."""

from __future__ import annotations

import time
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from weft.renderer.render import run

ERROR_PROBABILITY = 1e-4
"""Chance that a comparison fails although both programs are right (two-sided, Sidak over its parts)."""
NO_ERROR = 1e-5
"""Of a pixel that holds background alone, whose variance is rounding."""


@dataclass(frozen=True)
class PeerImage:
    mean: np.ndarray
    """Pixel means, float64, shape [height, width], averaged over RGB, or [height, width, 3]."""
    variance: np.ndarray
    """Variance of each pixel mean, from independent runs, same shape."""
    paths: int
    cpu_seconds: float


def weft_image(config, volume, scattering) -> PeerImage:
    """Shape [height, width, 3], with the variance that the film estimates."""
    started = time.process_time()
    result = run(config, volume, scattering)
    seconds = time.process_time() - started
    variance = np.stack([result.layers[f"variance.{c}"] for c in "RGB"], -1).astype(float)
    return PeerImage(result.radiance.astype(float), variance, result.statistics.paths, seconds)


def mitsuba_image(mi, scene: dict, *, runs: int, samples: int, seed: int) -> PeerImage:
    """Shape [height, width, 3]: so many independent pictures, pooled."""
    loaded = mi.load_dict(scene)
    started = time.process_time()
    images = [np.asarray(mi.render(loaded, spp=samples, seed=seed + i))[..., :3] for i in range(runs)]
    seconds = time.process_time() - started
    stack = np.stack(images).astype(float)
    pixels = stack.shape[1] * stack.shape[2]
    return PeerImage(stack.mean(0), stack.var(0, ddof=1) / runs, runs * samples * pixels, seconds)


def perspective_sensor(mi, *, position, target, fov_deg: float, size: int) -> dict:
    """A pinhole with a box filter, for `mi.load_dict`; the picture is square."""
    to_world = mi.ScalarTransform4f().look_at(origin=list(position), target=list(target), up=[0, 1, 0])
    film = {"type": "hdrfilm", "width": size, "height": size, "pixel_format": "rgb"}
    return {
        "type": "perspective",
        "fov": fov_deg,
        "to_world": to_world,
        "sampler": {"type": "independent"},
        "film": {**film, "rfilter": {"type": "box"}},
    }


def tile_sums(image: np.ndarray, tile: int) -> np.ndarray:
    """Of a square picture with three channels, shape [n, n, 3]."""
    n = len(image) // tile
    return image.reshape(n, tile, n, tile, 3).sum(axis=(1, 3))


def welch(a: PeerImage, b: PeerImage, tile: int) -> np.ndarray:
    """Difference of each tile and channel in standard errors."""
    error = np.sqrt(tile_sums(a.variance + b.variance, tile))
    return tile_sums(a.mean - b.mean, tile) / np.maximum(error, NO_ERROR * tile**2)


def threshold(count: int) -> float:
    """|z| that `count` fair comparisons all stay below with probability 1 - ERROR_PROBABILITY."""
    each = 1 - (1 - ERROR_PROBABILITY) ** (1 / count)
    return NormalDist().inv_cdf(1 - each / 2)
