"""Disney's principled BRDF: equal to its twin, samples by density, weight = value / density. 1e-4 each."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from weft.renderer.config import ConstantLight, PerspectiveCamera, RenderConfig, StudioLight
from weft.renderer.render import run
from weft.renderer.scene import IsotropicPhase
from weft.renderer.surface_config import (
    DiffuseMaterial,
    GroundSurface,
    MeshSurface,
    Placement,
    PrincipledMaterial,
)

from .directions import direction, hemisphere
from .meshes import write_ball
from .principled_reference import NAMES, principled
from .probe import probe
from .statistics import Z_LIMIT, welch_z
from .volumes import uniform_grid, volume

pytestmark = pytest.mark.gl

COLOR = (0.7, 0.4, 0.1)
USUAL = dict(zip(NAMES, (0.0, 0.0, 0.5, 0.0, 0.5, 0.0, 0.0, 0.5, 0.0, 1.0), strict=True))
MATERIALS = {
    "usual": USUAL,
    "subsurface": USUAL | {"subsurface": 0.8},
    "metal": USUAL | {"metallic": 1.0, "roughness": 0.3},
    "tinted": USUAL | {"specular": 1.0, "specular_tint": 0.7, "roughness": 0.2},
    "brushed": USUAL | {"metallic": 0.7, "anisotropic": 0.9, "roughness": 0.5},
    "sheen": USUAL | {"sheen": 1.0, "sheen_tint": 0.3},
    "coated": USUAL | {"clearcoat": 1.0, "clearcoat_gloss": 0.2},
    "all": dict(zip(NAMES, (0.3, 0.2, 0.8, 0.4, 0.35, 0.6, 0.7, 0.2, 0.9, 0.5), strict=True)),
}
WRAPPER = """
#include "surface/principled.glsl"
Principled made(vec4 a, vec4 b, vec2 c) {
    return Principled(vec3(0.7, 0.4, 0.1), a.x, a.y, a.z, a.w, b.x, b.y, b.z, b.w, c.x, c.y);
}
vec3 value_of(vec4 a, vec4 b, vec2 c, vec3 wo, vec3 wi, out float pdf) {
    pdf = principled_pdf(made(a, b, c), wo, wi);
    return principled_eval(made(a, b, c), wo, wi);
}
vec3 sample_of(vec4 a, vec4 b, vec2 c, vec3 wo, vec3 u) {
    return principled_sample(made(a, b, c), wo, u);
}
"""
value_of = probe(
    [], "vec3 value_of(vec4 a, vec4 b, vec2 c, vec3 wo, vec3 wi, out float pdf)", prelude=WRAPPER
)
sample_of = probe([], "vec3 sample_of(vec4 a, vec4 b, vec2 c, vec3 wo, vec3 u)", prelude=WRAPPER)


@pytest.fixture(scope="module", autouse=True)
def _programs_end_with_the_module():
    yield
    value_of.program = sample_of.program = None


def packed(name):
    values = [MATERIALS[name][key] for key in NAMES]
    return values[:4], values[4:8], values[8:]


@pytest.mark.parametrize("name", MATERIALS)
def test_equals_its_twin_and_is_reciprocal(name):
    rng = np.random.default_rng(1)
    wo, wi = rng.normal(size=(2, 2000, 3))
    wo, wi = (w / np.linalg.norm(w, axis=-1, keepdims=True) for w in (wo, wi))
    wo[:, 2] = np.abs(wo[:, 2])
    wo, wi = wo.astype(np.float32).astype(float), wi.astype(np.float32).astype(float)
    value, _ = value_of(*packed(name), wo, wi)
    np.testing.assert_allclose(value, principled(COLOR, MATERIALS[name], wo, wi), rtol=2e-4, atol=1e-6)
    other, _ = value_of(*packed(name), wi, wo)
    np.testing.assert_allclose(value, other, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("view", [(20, 30), (70, -50)])
@pytest.mark.parametrize("name", MATERIALS)
def test_samples_follow_their_density(name, view):
    """Chi-square over cells of equal solid angle, and one for all samples below the surface."""
    wo = direction(*view)
    cosines, azimuths, fine = 16, 24, 24
    _, pdf = value_of(*packed(name), wo, hemisphere(cosines * fine, azimuths * fine))
    cell = pdf.astype(float).reshape(cosines, fine, azimuths, fine).sum(axis=(1, 3))
    share = cell * 2 * np.pi / (cosines * azimuths * fine**2)
    count = 60_000
    wi = sample_of(*packed(name), wo, np.random.default_rng(2).random((count, 3), dtype=np.float32))
    wi = wi.astype(float)
    np.testing.assert_allclose(np.linalg.norm(wi, axis=-1), 1, atol=1e-4)
    above = wi[wi[:, 2] > 0]
    azimuth = np.arctan2(above[:, 1], above[:, 0])
    seen = np.histogram2d(above[:, 2], azimuth, [cosines, azimuths], [[0, 1], [-np.pi, np.pi]])[0]
    shares = np.append(share.ravel(), 1 - share.sum())
    counts = np.append(seen.ravel(), count - len(above))
    order = np.argsort(shares)
    small = np.cumsum(shares[order]) * count < 20
    shares = np.append(shares[order][~small], shares[order][small].sum())
    counts = np.append(counts[order][~small], counts[order][small].sum())
    expected = np.maximum(shares * count, 1e-9)
    statistic = ((counts - expected) ** 2 / expected)[expected > 1].sum()
    assert stats.chi2.sf(statistic, (expected > 1).sum() - 1) > 1e-4


@pytest.mark.parametrize("name", MATERIALS)
def test_weights_average_to_the_reflected_part(name):
    """Mean of value x cosine / density over samples is the integral over the hemisphere by the twin."""
    wo = direction(40, 20)
    wi = sample_of(*packed(name), wo, np.random.default_rng(3).random((200_000, 3), dtype=np.float32))
    value, pdf = value_of(*packed(name), wo, wi)
    weight = np.where(pdf > 0, value[:, 1] * wi[:, 2] / np.maximum(pdf, 1e-30), 0).astype(float)
    grid = hemisphere(1500, 1500)
    exact = (principled(COLOR, MATERIALS[name], wo, grid)[..., 1] * grid[..., 2]).mean() * 2 * np.pi
    z = (weight.mean() - exact) / (weight.std() / np.sqrt(len(weight)))
    assert abs(z) < Z_LIMIT
    assert weight.max() < 12


def picture(folder, sampling, seed, materials):
    file = write_ball(folder, subdivisions=3)
    balls = [
        MeshSurface(file=file, material=m, placements=[Placement(position_mm=(5 + 2.2 * i, 0, 0))])
        for i, m in enumerate(materials)
    ]
    config = RenderConfig(
        resolution=(48, 20),
        samples_per_pixel=256,
        seed=seed,
        max_bounces=4,
        sampling=sampling,
        lights=[StudioLight(), ConstantLight(radiance=(0.5, 0.5, 0.5))],
        surfaces=[*balls, GroundSurface(gap_mm=1, size_mm=60)],
        camera=PerspectiveCamera(position_mm=(7.2, 3, 16), target_mm=(7.2, 0, 0), fov_deg=26),
    )
    speck = volume(uniform_grid((1, 1, 1), 0.5, (1, 0, 0)))
    return run(config, speck, {"a": IsotropicPhase()})


def test_lights_and_brdf_sampling_agree(tmp_path):
    """Rough enough that light sampling alone converges."""
    materials = [
        PrincipledMaterial(color=COLOR, roughness=0.6, sheen=1.0),
        PrincipledMaterial(color=COLOR, metallic=1.0, roughness=0.7, anisotropic=0.5),
        DiffuseMaterial(color=COLOR),
    ]
    one, two, three = (picture(tmp_path, s, i, materials) for i, s in enumerate(("both", "lights", "phase")))
    for channel in range(3):
        assert abs(welch_z(one, two, channel=channel)) < Z_LIMIT
        assert abs(welch_z(one, three, channel=channel)) < Z_LIMIT
    assert one.statistics.broken_samples == 0


def test_a_diffuse_material_is_the_same_beside_principled_ones(tmp_path):
    diffuse = DiffuseMaterial(color=COLOR)
    alone = picture(tmp_path, "both", 1, [diffuse, diffuse])
    beside = picture(tmp_path, "both", 2, [diffuse, diffuse, PrincipledMaterial(color=(0, 0, 0), specular=0)])
    left = slice(0, 20)
    a, b = (p.radiance[:, left, 1].mean() for p in (alone, beside))
    assert a == pytest.approx(b, rel=0.02)
