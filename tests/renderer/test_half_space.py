"""Many scatterings against theory: Chandrasekhar's half space and the diffusion limit of a thick slab.

Each z stays below 3.9: error probability 1e-4.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from weft.renderer.config import ConstantLight, DirectionalLight, OrthographicCamera, QuadLight, RenderConfig
from weft.renderer.media_config import BoxBound, HomogeneousMedium, IsotropicScattering
from weft.renderer.render import run
from weft.renderer.simple_phases import IsotropicPhase

from .statistics import Z_LIMIT, z_score
from .volumes import uniform_grid, volume

pytestmark = pytest.mark.gl

NOTHING = dataclasses.replace(uniform_grid((1, 1, 1), 0.0, (0.0, 1.0, 0.0)), voxel_size_mm=2.0)
MILNE = 0.7104460896
"""Extrapolation length of Milne's problem [mean free paths]."""


def h_function(albedo: float, mu: np.ndarray) -> np.ndarray:
    """Chandrasekhar's H for isotropic scattering: 1/H(m) = sqrt(1 - w) + w/2 integral of x H(x) / (m + x)."""
    nodes, weights = np.polynomial.legendre.leggauss(96)
    # squared nodes resolve the logarithm near zero
    x, w = (nodes / 2 + 0.5) ** 2, weights * (nodes / 2 + 0.5)
    h = np.ones_like(x)
    for _ in range(4000):
        new = 1 / (math.sqrt(1 - albedo) + albedo / 2 * ((w * x * h) / (x[:, None] + x)).sum(axis=1))
        change, h = np.abs(new - h).max(), (new + h) / 2
        if change < 1e-12:
            break
    kernel = (w * x * h) / (np.asarray(mu, np.float64)[..., None] + x)
    return 1 / (math.sqrt(1 - albedo) + albedo / 2 * kernel.sum(axis=-1))


def slab_picture(depth_mm, extinction, albedo, view, lights, *, samples):
    """A slab of which the face at z = 0 is seen, 200 mm wide."""
    slab = BoxBound(lower_mm=(-100.0, -100.0, -depth_mm), upper_mm=(100.0, 100.0, 0.0))
    medium = HomogeneousMedium(
        bound=slab, extinction_per_mm=extinction, scattering=IsotropicScattering(albedo=albedo)
    )
    config = RenderConfig(
        resolution=(24, 24),
        samples_per_pixel=samples,
        max_bounces=10**6,
        camera=OrthographicCamera(view_direction=view, target_mm=(0.0, 0.0, 0.0), frame_width_mm=1e-3),
        lights=lights,
        media=[medium],
    )
    return run(config, volume(NOTHING), {"a": IsotropicPhase()})


def test_the_twin_has_known_values():
    """Chandrasekhar's table XI: H(1) is 2.9078 for albedo 1; and the mean of H is 2 (1 - sqrt(1 - w)) / w."""
    assert h_function(1.0, np.array([1.0]))[0] == pytest.approx(2.9078, abs=2e-4)
    nodes, weights = np.polynomial.legendre.leggauss(64)
    mean = (h_function(0.9, nodes / 2 + 0.5) * weights / 2).sum()
    assert mean == pytest.approx(2 * (1 - math.sqrt(0.1)) / 0.9, abs=1e-4)


@pytest.mark.parametrize(
    ("view_cosine", "light_cosine"), [(0.3, 0.5), pytest.param(1.0, 0.8, marks=pytest.mark.proof)]
)
def test_a_half_space_reflects_as_chandrasekhar_says(view_cosine, light_cosine):
    """w E/(4 pi) m0/(m + m0) H(m) H(m0), whatever the extinction: three of it, and three albedos."""
    albedo = (0.5, 0.9, 0.98)
    view = (math.sqrt(1 - view_cosine**2), 0.0, view_cosine)
    sun = (0.0, math.sqrt(1 - light_cosine**2), light_cosine)
    lights = [DirectionalLight(direction=sun)]
    result = slab_picture(60.0, (2.0, 5.0, 3.0), albedo, view, lights, samples=64)
    for channel, w in enumerate(albedo):
        h = np.prod(h_function(w, np.array([view_cosine, light_cosine])))
        expected = w / (4 * math.pi) * light_cosine / (view_cosine + light_cosine) * h
        assert abs(z_score(result, expected, channel=channel)) < Z_LIMIT


@pytest.mark.proof
def test_a_thick_white_slab_has_its_diffusion_limit():
    """Light of radiance 1 all over one side; on the other H(1) / (sqrt(3) (tau + 2 q)), q after Milne."""
    depth = 8.0
    window = QuadLight(
        position_mm=(0.0, 0.0, -depth - 0.01),
        target_mm=(0.0, 0.0, 0.0),
        width_mm=400.0,
        height_mm=400.0,
        radiance=(1.0, 1.0, 1.0),
    )
    lights = [window, ConstantLight(radiance=(0.0, 0.0, 0.0))]
    result = slab_picture(depth, 1.0, 1.0, (0.0, 0.0, 1.0), lights, samples=48)
    expected = h_function(1.0, np.array([1.0]))[0] / (math.sqrt(3) * (depth + 2 * MILNE))
    assert abs(z_score(result, expected)) < Z_LIMIT
