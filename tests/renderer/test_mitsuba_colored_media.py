"""A homogeneous block whose extinction and albedo depend on color looks as in Mitsuba 3."""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np
import pytest

from weft.renderer.config import ConstantLight, DirectionalLight, PerspectiveCamera, RenderConfig
from weft.renderer.media_config import BoxBound, HenyeyGreensteinScattering, HomogeneousMedium
from weft.renderer.render import run
from weft.renderer.simple_phases import IsotropicPhase

from .volumes import uniform_grid, volume

pytestmark = pytest.mark.gl

ERROR_PROBABILITY = 1e-4
"""Chance that one of the comparisons fails although both programs are right (Sidak over all of them)."""
SIZE, TILE = 32, 8
EXTINCTION, ALBEDO, G = (0.8, 2.0, 5.0), (0.95, 0.8, 0.6), 0.5
LOWER, UPPER = (-0.5, -0.4, -0.6), (0.7, 0.5, 0.4)
POSITION, TARGET, FOV = (2.0, 1.5, 3.0), (0.1, 0.05, -0.1), 30.0
SUN, SUN_IRRADIANCE, SKY = (1.0, 2.0, -0.5), 2.0, 0.3


def weft_picture() -> tuple[np.ndarray, np.ndarray]:
    """Mean and variance of each pixel's mean, [SIZE, SIZE, 3]."""
    block = HomogeneousMedium(
        bound=BoxBound(lower_mm=LOWER, upper_mm=UPPER),
        extinction_per_mm=EXTINCTION,
        scattering=HenyeyGreensteinScattering(g=G, albedo=ALBEDO),
    )
    config = RenderConfig(
        resolution=(SIZE, SIZE),
        samples_per_pixel=512,
        seed=7,
        camera=PerspectiveCamera(position_mm=POSITION, target_mm=TARGET, fov_deg=FOV),
        lights=[
            ConstantLight(radiance=(SKY,) * 3),
            DirectionalLight(direction=SUN, irradiance=(SUN_IRRADIANCE,) * 3),
        ],
        background="environment",
        media=[block],
    )
    nothing = volume(uniform_grid((1, 1, 1), 0.0, (0.0, 1.0, 0.0)))
    result = run(config, nothing, {"a": IsotropicPhase()})
    variance = np.stack([result.layers[f"variance.{c}"] for c in "RGB"], axis=-1)
    return result.radiance.astype(np.float64), variance.astype(np.float64)


def mitsuba_picture(runs: int, samples: int) -> tuple[np.ndarray, np.ndarray]:
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    low, high = np.array(LOWER), np.array(UPPER)
    place = mi.ScalarTransform4f().translate(list((low + high) / 2)).scale(list((high - low) / 2))
    peak = max(EXTINCTION)
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "volpath", "max_depth": 1000, "rr_depth": 1000},
            "sky": {"type": "constant", "radiance": SKY},
            "sun": {"type": "directional", "direction": [-x for x in SUN], "irradiance": SUN_IRRADIANCE},
            "block": {
                "type": "cube",
                "to_world": place,
                "bsdf": {"type": "null"},
                "interior": {
                    "type": "homogeneous",
                    "sigma_t": {"type": "rgb", "value": [s / peak for s in EXTINCTION]},
                    "scale": peak,
                    "albedo": {"type": "rgb", "value": list(ALBEDO)},
                    "phase": {"type": "hg", "g": G},
                },
            },
            "sensor": {
                "type": "perspective",
                "fov": FOV,
                "to_world": mi.ScalarTransform4f().look_at(
                    origin=list(POSITION), target=list(TARGET), up=[0, 1, 0]
                ),
                "sampler": {"type": "independent"},
                "film": {
                    "type": "hdrfilm",
                    "width": SIZE,
                    "height": SIZE,
                    "rfilter": {"type": "box"},
                    "pixel_format": "rgb",
                },
            },
        }
    )
    images = [np.asarray(mi.render(scene, spp=samples, seed=run), np.float64)[..., :3] for run in range(runs)]
    stack = np.stack(images)
    return stack.mean(0), stack.var(0, ddof=1) / runs


def tile_sums(image: np.ndarray) -> np.ndarray:
    count = SIZE // TILE
    return image.reshape(count, TILE, count, TILE, 3).sum(axis=(1, 3))


def test_every_color_agrees_with_mitsuba_as_a_whole_and_in_every_tile():
    pytest.importorskip("mitsuba", reason="Mitsuba 3 is not installed")
    (ours, our_variance), (theirs, their_variance) = weft_picture(), mitsuba_picture(runs=12, samples=24)
    difference, variance = ours - theirs, our_variance + their_variance
    whole = difference.sum(axis=(0, 1)) / np.sqrt(variance.sum(axis=(0, 1)))
    tiles = tile_sums(difference) / np.sqrt(np.maximum(tile_sums(variance), 1e-9))
    lit = tile_sums(variance) > 1e-6
    assert lit.all(axis=-1).sum() >= 8, "the block should cover much of the picture"
    limit = NormalDist().inv_cdf(1 - ERROR_PROBABILITY / 2 / (3 + lit.sum()))
    assert np.abs(whole).max() < limit
    assert np.abs(tiles[lit]).max() < limit
    assert 0.6 < tiles[lit].std() < 1.5, "differences should be as large as their standard errors"
    for channel in range(3):
        error = math.sqrt(variance[..., channel].sum()) / theirs[..., channel].sum()
        assert error < 4e-3, "too few samples to see a bias of two percent"
