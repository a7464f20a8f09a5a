"""The same grid, phase function and light in weft and in Mitsuba 3 give the same picture."""

from __future__ import annotations

import dataclasses
import math
from statistics import NormalDist

import numpy as np
import pytest

from tests.peers.mitsuba_volume import PeerImage, render_with_mitsuba
from tests.peers.scenes import twisted_yarns, yarn_axes
from tests.peers.weft_volume import render_with_weft

ERROR_PROBABILITY = 1e-4
"""Chance that either test below fails although both programs are right (two-sided, Sidak over the tiles)."""
TILE = 8
ROUNDING = 1e-5
"""Radiance below which a difference is rounding in single precision."""


PHASES = {
    "isotropic": {},
    "Henyey-Greenstein": {"g": 0.6},
    "SGGX": {"flake_roughness": 0.3, "axes": yarn_axes(64), "toward_sun": (0.5, 0.7, 1.0)},
}
"""SGGX scatters once under parallel light: Mitsuba 3.9.1 evaluates it as our twin does, samples it otherwise
(issue 1728; its white furnace reads 0.93 at roughness 0.3): many bounces cannot be compared."""


@pytest.fixture(scope="module", params=PHASES)
def images(request: pytest.FixtureRequest) -> tuple[PeerImage, PeerImage]:
    pytest.importorskip("mitsuba", reason="Mitsuba 3 is not installed")
    scene = twisted_yarns(64, peak_extinction=60.0, resolution=64, albedo=0.9)
    scene = dataclasses.replace(scene, **PHASES[request.param])
    mitsuba = render_with_mitsuba(scene, samples_per_run=16, runs=8, seed=11)
    return render_with_weft(scene, samples=192, seed=5), mitsuba


@pytest.mark.gl
def test_whole_picture_agrees_with_mitsuba(
    images: tuple[PeerImage, PeerImage], request: pytest.FixtureRequest
) -> None:
    weft, mitsuba = images
    enough = 4e-3 if request.node.callspec.params["images"] == "SGGX" else 1e-3
    z = _welch(weft, mitsuba, tile=weft.mean.shape[0])
    relative_error = math.sqrt(weft.variance.sum() + mitsuba.variance.sum()) / mitsuba.mean.sum()
    assert relative_error < enough, "too few samples to see a bias of a percent"
    assert abs(z.item()) < _threshold(1)


@pytest.mark.gl
def test_every_tile_agrees_with_mitsuba(images: tuple[PeerImage, PeerImage]) -> None:
    z = _welch(*images, tile=TILE)
    lit = np.isfinite(z)
    assert lit.sum() >= 24, "the yarns should cover much of the picture"
    assert np.abs(z[lit]).max() < _threshold(int(lit.sum()))
    assert 0.6 < z[lit].std() < 1.5, "differences should be as large as their standard errors"


def _welch(a: PeerImage, b: PeerImage, *, tile: int) -> np.ndarray:
    """Welch's z of the means of each tile; nan where both show only background (it rounds)."""
    difference = _tiles(a.mean - b.mean, tile)
    error = np.sqrt(_tiles(a.variance + b.variance, tile))
    background = error < ROUNDING * tile**2
    assert np.abs(difference[background]).max(initial=0) < ROUNDING * tile**2
    return np.where(background, np.nan, difference / np.maximum(error, ROUNDING))


def _tiles(image: np.ndarray, tile: int) -> np.ndarray:
    """Sums over tiles of a square picture."""
    count = image.shape[0] // tile
    return image.reshape(count, tile, count, tile).sum(axis=(1, 3))


def _threshold(count: int) -> float:
    """|z| that `count` fair comparisons all stay below with probability 1 - ERROR_PROBABILITY."""
    each = 1 - (1 - ERROR_PROBABILITY) ** (1 / count)
    return NormalDist().inv_cdf(1 - each / 2)
