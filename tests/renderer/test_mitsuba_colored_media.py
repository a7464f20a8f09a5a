"""A homogeneous block whose extinction and albedo depend on color looks as in Mitsuba 3."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.peers.compared_pictures import (
    PeerImage,
    mitsuba_image,
    perspective_sensor,
    threshold,
    tile_sums,
    weft_image,
    welch,
)
from weft.renderer.config import ConstantLight, DirectionalLight, PerspectiveCamera, RenderConfig
from weft.renderer.media_config import BoxBound, HenyeyGreensteinScattering, HomogeneousMedium
from weft.renderer.simple_phases import IsotropicPhase

from .volumes import uniform_grid, volume

pytestmark = pytest.mark.gl

SIZE, TILE = 32, 8
EXTINCTION, ALBEDO, G = (0.8, 2.0, 5.0), (0.95, 0.8, 0.6), 0.5
LOWER, UPPER = (-0.5, -0.4, -0.6), (0.7, 0.5, 0.4)
POSITION, TARGET, FOV = (2.0, 1.5, 3.0), (0.1, 0.05, -0.1), 30.0
SUN, SUN_IRRADIANCE, SKY = (1.0, 2.0, -0.5), 2.0, 0.3


def weft_picture() -> PeerImage:
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
    return weft_image(config, nothing, {"a": IsotropicPhase()})


def mitsuba_picture() -> PeerImage:
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    low, high = np.array(LOWER), np.array(UPPER)
    place = mi.ScalarTransform4f().translate(list((low + high) / 2)).scale(list((high - low) / 2))
    peak = max(EXTINCTION)
    scene = {
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
        "sensor": perspective_sensor(mi, position=POSITION, target=TARGET, fov_deg=FOV, size=SIZE),
    }
    return mitsuba_image(mi, scene, runs=12, samples=24, seed=0)


def test_every_color_agrees_with_mitsuba_as_a_whole_and_in_every_tile():
    pytest.importorskip("mitsuba", reason="Mitsuba 3 is not installed")
    ours, theirs = weft_picture(), mitsuba_picture()
    variance = ours.variance + theirs.variance
    whole, tiles = welch(ours, theirs, SIZE), welch(ours, theirs, TILE)
    lit = tile_sums(variance, TILE) > 1e-6
    assert lit.all(axis=-1).sum() >= 8, "the block should cover much of the picture"
    limit = threshold(3 + lit.sum())
    assert np.abs(whole).max() < limit
    assert np.abs(tiles[lit]).max() < limit
    assert 0.6 < tiles[lit].std() < 1.5, "differences should be as large as their standard errors"
    for channel in range(3):
        error = math.sqrt(variance[..., channel].sum()) / theirs.mean[..., channel].sum()
        assert error < 4e-3, "too few samples to see a bias of two percent"
