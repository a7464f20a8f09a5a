"""Henyey-Greenstein, SGGX and emitting media in the tracer. Error probability 1e-4 per z."""

from __future__ import annotations

import math

import numpy as np
import pytest

from weft.files.errors import InputError
from weft.renderer.config import ConstantLight, OrthographicCamera, PerspectiveCamera, RenderConfig
from weft.renderer.render import run
from weft.renderer.simple_phases import HenyeyGreensteinPhase, IsotropicPhase, SggxPhase

from .statistics import Z_LIMIT, picture_mean, welch_z, z_score
from .volumes import RADIUS_MM, VOXEL_MM, projected_extinction, random_grid, uniform_grid, volume

pytestmark = pytest.mark.gl

FLAKES = SggxPhase(0.3)


def uniform_light(grid, phase, *, samples=64, **settings):
    defaults = {
        "resolution": (32, 32),
        "samples_per_pixel": samples,
        "max_bounces": 10**6,
        "camera": PerspectiveCamera(fov_deg=12, view_direction=(0.3, 0.4, 1.0)),
        "lights": [ConstantLight()],
        "background": "environment",
        "sampling": "both_plain",
    }
    return run(RenderConfig(**(defaults | settings)), volume(*grid), phase)


@pytest.mark.parametrize(
    "phase", [IsotropicPhase(), HenyeyGreensteinPhase(0.8), HenyeyGreensteinPhase(-0.5), FLAKES], ids=str
)
@pytest.mark.parametrize("tracking", ["exact", "delta"])
def test_white_furnace(phase, tracking):
    grid = random_grid((3, 3, 3), seed=21, fill=0.6, peak=0.5)
    result = uniform_light([grid], {"a": phase}, tracking=tracking)
    assert abs(z_score(result, 1.0)) < Z_LIMIT
    assert result.statistics.broken_samples == 0


@pytest.mark.parametrize("cosine", [0.0, 0.6, 1.0])
@pytest.mark.parametrize("tracking", ["exact", "delta"])
def test_flakes_hide_their_projected_area(cosine, tracking):
    """exp(-(2 phi/(pi a)) sqrt(w S w) L); along the fibers their ends are seen, r wide."""
    grid = uniform_grid((2, 2, 2), 0.02, (cosine, 0.0, math.sqrt(1 - cosine**2)))
    result = uniform_light(
        [grid],
        {"a": SggxPhase(0.3, (0.0, 0.0, 0.0))},
        camera=OrthographicCamera(view_direction=(1.0, 0.0, 0.0), frame_width_mm=1e-3),
        tracking=tracking,
    )
    area = math.sqrt(1 - (1 - 0.3**2) * cosine**2)
    expected = math.exp(-2 * 0.02 / (math.pi * RADIUS_MM) * area * 16 * VOXEL_MM)
    assert abs(z_score(result, expected)) < Z_LIMIT


def test_a_glowing_slab_has_its_closed_form():
    """Emission E per optical depth and no light: E (1 - exp(-tau))."""
    grid = uniform_grid((2, 2, 2), 0.02, (0.0, 1.0, 0.0))
    result = uniform_light(
        [grid],
        {"a": IsotropicPhase((0.0, 0.0, 0.0), (3.0, 2.0, 1.0))},
        camera=OrthographicCamera(view_direction=(1.0, 0.0, 0.0), frame_width_mm=1e-3),
        lights=[ConstantLight(radiance=(0.0, 0.0, 0.0))],
    )
    depth = projected_extinction(0.02, 0.0) * 16 * VOXEL_MM
    for channel, emission in enumerate((3.0, 2.0, 1.0)):
        assert abs(z_score(result, emission * -math.expm1(-depth), channel=channel)) < Z_LIMIT


def test_media_of_three_kinds_overlap_in_any_order():
    """Each collision chooses its medium in proportion to extinction: their order does not matter."""
    grids = [random_grid((2, 2, 2), seed=seed, peak=0.3) for seed in (42, 43, 44)]
    phases = [
        IsotropicPhase((0.9, 0.1, 0.1)),
        HenyeyGreensteinPhase(0.7, (0.1, 0.9, 0.1)),
        IsotropicPhase((0.2, 0.2, 0.2), (0.0, 0.1, 0.5)),
    ]
    pictures = []
    for seed, order in enumerate(([0, 1, 2], [2, 0, 1])):
        media = {name: phases[i] for name, i in zip("abc", order, strict=True)}
        pictures.append(uniform_light([grids[i] for i in order], media, seed=seed))
    for channel in range(3):
        assert abs(welch_z(*pictures, channel=channel)) < Z_LIMIT
    means = [picture_mean(pictures[0], channel=channel)[0] for channel in range(3)]
    assert np.ptp(means) > 0.02


def test_what_cannot_be_is_refused():
    with pytest.raises(InputError, match="g is 1"):
        HenyeyGreensteinPhase(1.0)
    with pytest.raises(InputError, match="roughness"):
        SggxPhase(0.0)
    grids = [random_grid((1, 1, 1), seed=seed) for seed in (1, 2)]
    with pytest.raises(InputError, match="one roughness"):
        uniform_light(grids, {"a": SggxPhase(0.3), "b": SggxPhase(0.5)})
