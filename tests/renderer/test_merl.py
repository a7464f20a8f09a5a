"""Measured surfaces: equal to the reader, samples by density, weight = value / density. 1e-4 each."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from scipy import stats

from weft.files.errors import InputError
from weft.files.measured.merl import center_directions
from weft.renderer.config import ConstantLight, PerspectiveCamera, RenderConfig, StudioLight
from weft.renderer.measured_surface import VIEWS, measured_surface, read_measured_surface
from weft.renderer.render import run
from weft.renderer.scene import IsotropicPhase
from weft.renderer.surface_config import DiffuseMaterial, GroundSurface, MerlMaterial, MeshSurface, Placement

from .directions import direction, hemisphere
from .merl_models import glossy, gold_paint, matte, table_of, write_model
from .meshes import write_ball
from .probe import probe
from .statistics import Z_LIMIT, picture_mean, welch_z, z_score
from .volumes import uniform_grid, volume

MODELS = {
    "matte": lambda: matte(0.8),
    "paint": gold_paint,
    "noise": lambda: table_of(np.random.default_rng(6).random((90 * 90 * 180, 3))),
    "mirror-like": lambda: glossy((0.9, 0.8, 0.7), 0.12, (0.0, 0.0, 0.0)),
}


@pytest.fixture(scope="module", params=MODELS)
def model(request):
    """A table, and its three functions on the device."""
    table = MODELS[request.param]()
    common = {
        "constants": {"MERL_VIEWS": VIEWS},
        "prelude": "layout(std430, binding = 2) readonly buffer L { vec4 lights[]; };",
        "blocks": {2: measured_surface(table).rows},
    }
    made = [
        probe("surface/merl.glsl", signature, **common)
        for signature in (
            "vec3 merl_eval(uint table, vec3 wo, vec3 wi)",
            "float merl_pdf(uint table, vec3 wo, vec3 wi)",
            "vec3 merl_sample(uint table, vec3 wo, vec3 u)",
        )
    ]
    yield table, *(lambda *arguments, call=call: call(0, *arguments) for call in made)
    for call in made:
        call.program = None


@pytest.mark.gl
def test_in_the_middle_of_cells_it_is_what_the_reader_reads(model):
    """Every thirteenth cell, turned about the normal; the smallest cell is 0.01 degrees high."""
    table, evaluate, *_ = model
    turn = np.array([[0.8, 0.6, 0], [-0.6, 0.8, 0], [0, 0, 1]])
    light, detector = (w[4 * 16200 :: 13] @ turn for w in center_directions())
    exact = table.evaluate(light, detector)
    np.testing.assert_allclose(evaluate(detector, light), exact, rtol=1e-6)
    np.testing.assert_allclose(evaluate(light, detector), exact, rtol=1e-6)
    assert (exact > 0).any()


@pytest.mark.gl
def test_anywhere_it_is_what_the_reader_reads_but_for_rounding_at_edges(model):
    table, evaluate, *_ = model
    wo, wi = np.random.default_rng(1).normal(size=(2, 100_000, 3))
    wo, wi = (w / np.linalg.norm(w, axis=-1, keepdims=True) for w in (wo, wi))
    exact = table.evaluate(wi, wo)
    close = np.isclose(evaluate(wo, wi), exact, rtol=1e-5, atol=1e-9).all(axis=1)
    assert close.mean() > 0.999
    below = (wo[:, 2] <= 0) | (wi[:, 2] <= 0)
    assert not evaluate(wo[below], wi[below]).any()


@pytest.mark.gl
@pytest.mark.parametrize("view", [(3, 30), (40, 200), (80, -50)])
def test_samples_follow_their_density(model, view):
    """Chi-square over cells of equal solid angle around the mirror direction's height, one for all below."""
    _, _, density, sample = model
    wo = direction(*view)
    cosines, azimuths, fine = 12, 16, 60
    wi = hemisphere(cosines * fine, azimuths * fine)
    cell = density(wo, wi).astype(float).reshape(cosines, fine, azimuths, fine).sum(axis=(1, 3))
    share = cell * 2 * np.pi / (cosines * azimuths * fine**2)
    count = 60_000
    wi = sample(wo, np.random.default_rng(2).random((count, 3), dtype=np.float32)).astype(float)
    np.testing.assert_allclose(np.linalg.norm(wi, axis=-1), 1, atol=1e-4)
    above = wi[wi[:, 2] > 0]
    azimuth = np.arctan2(above[:, 1], above[:, 0])
    seen = np.histogram2d(above[:, 2], azimuth, [cosines, azimuths], [[0, 1], [-np.pi, np.pi]])[0]
    shares, counts = np.append(share.ravel(), 1 - share.sum()), np.append(seen.ravel(), count - len(above))
    small = shares * count < 20
    shares = np.append(shares[~small], shares[small].sum())
    counts = np.append(counts[~small], counts[small].sum())
    usable = shares * count > 1
    expected = shares[usable] * count
    assert stats.chisquare(counts[usable], expected * counts[usable].sum() / expected.sum()).pvalue > 1e-4


@pytest.mark.gl
@pytest.mark.parametrize("theta", [10, 60, 82])
def test_weights_average_to_the_reflected_part(model, theta):
    """Against the reader, over half vectors in every cell."""
    table, evaluate, density, sample = model
    wo = direction(theta, 20)
    wi = sample(wo, np.random.default_rng(3).random((200_000, 3), dtype=np.float32))
    value, pdf = evaluate(wo, wi)[:, 1], density(wo, wi)
    weight = np.where(pdf > 0, value * wi[:, 2] / np.maximum(pdf, 1e-30), 0).astype(float)
    exact = reflected(table, theta)[1]
    assert abs(weight.mean() - exact) < Z_LIMIT * weight.std() / np.sqrt(len(weight)) + 2e-3 * exact
    assert weight.max() < 9 * weight.mean()


def reflected(table, theta, azimuths=720, parts=6):
    """Light sent back, by quadrature over half vectors, several heights to a cell of theta_h."""
    edges = (np.arange(90 * parts + 1) / (90 * parts)) ** 2 * (np.pi / 2)
    cos_h = (np.cos(edges[1:]) + np.cos(edges[:-1])) / 2
    solid = 2 * np.pi * (np.cos(edges[:-1]) - np.cos(edges[1:])) / azimuths
    phi = (np.arange(azimuths) + 0.5) / azimuths * 2 * np.pi
    sin_h = np.sqrt(1 - cos_h**2)[:, None]
    h = np.stack(np.broadcast_arrays(sin_h * np.cos(phi), sin_h * np.sin(phi), cos_h[:, None]), -1)
    wo = direction(theta, 0)
    cos_d = h @ wo
    wi = 2 * cos_d[..., None] * h - wo
    value = table.evaluate(wi.reshape(-1, 3), np.broadcast_to(wo, (wi.size // 3, 3))).reshape(wi.shape)
    factor = np.where(cos_d > 0, np.maximum(wi[..., 2], 0) * 4 * cos_d, 0) * solid[:, None]
    return (value * factor[..., None]).sum(axis=(0, 1))


def picture(folder, materials, **settings):
    """A row of balls on a gray ground under the studio."""
    file = write_ball(folder, subdivisions=3)
    balls = [
        MeshSurface(file=file, material=m, placements=[Placement(position_mm=(5 + 2.2 * i, 0, 0))])
        for i, m in enumerate(materials)
    ]
    defaults = {
        "resolution": (36, 20),
        "samples_per_pixel": 128,
        "max_bounces": 4,
        "lights": [StudioLight(), ConstantLight(radiance=(0.5, 0.5, 0.5))],
        "surfaces": [*balls, GroundSurface(gap_mm=1, size_mm=60)],
        "camera": PerspectiveCamera(position_mm=(6.1, 3, 16), target_mm=(6.1, 0, 0), fov_deg=20),
    }
    speck = volume(uniform_grid((1, 1, 1), 0.5, (1, 0, 0)))
    return run(RenderConfig(**(defaults | settings)), speck, {"a": IsotropicPhase()})


@pytest.mark.gl
def test_a_white_table_in_white_light_cannot_be_seen(tmp_path):
    white = MerlMaterial(file=write_model(tmp_path, "white", matte(1.0)))
    ball = MeshSurface(
        file=write_ball(tmp_path), material=white, smooth=False, placements=[Placement(position_mm=(5, 0, 0))]
    )
    result = picture(
        tmp_path,
        [],
        surfaces=[ball],
        lights=[ConstantLight()],
        sampling="both_plain",
        background=(1.0, 1.0, 1.0),
        max_bounces=1000,
        samples_per_pixel=256,
        camera=PerspectiveCamera(position_mm=(5, 3, 16), target_mm=(5, 0, 0), fov_deg=6),
    )
    assert abs(z_score(result, 1.0)) < Z_LIMIT
    assert picture_mean(result)[1] < 1e-3


@pytest.mark.gl
def test_a_matte_table_looks_like_the_diffuse_material(tmp_path):
    matte_table = MerlMaterial(file=write_model(tmp_path, "matte", matte(0.5)))
    one = picture(tmp_path, [matte_table] * 2, seed=1)
    other = picture(tmp_path, [DiffuseMaterial(color=(0.5, 0.5, 0.5))] * 2, seed=2)
    assert abs(welch_z(one, other, channel=1)) < Z_LIMIT


@pytest.mark.gl
def test_lights_and_brdf_sampling_agree(tmp_path):
    paint = MerlMaterial(file=write_model(tmp_path, "paint", gold_paint()))
    materials = [paint, DiffuseMaterial()]
    pictures = [
        picture(tmp_path, materials, sampling=s, seed=i) for i, s in enumerate(("both", "lights", "phase"))
    ]
    for channel in (0, 2):
        assert abs(welch_z(pictures[0], pictures[1], channel=channel)) < Z_LIMIT
        assert abs(welch_z(pictures[0], pictures[2], channel=channel)) < Z_LIMIT


def test_cells_without_a_measurement_reflect_nothing():
    table = matte(0.5)
    table.planes[1, 30, 10, 7] = -1.0
    rows = measured_surface(table).rows
    assert not rows[(30 * 90 + 10) * 180 + 7].any()
    assert (rows[:1_458_000, :3] > 0).all(axis=1).sum() == 1_458_000 - 1


def test_a_black_table_can_be_drawn():
    surface = measured_surface(matte(0.0))
    assert np.isfinite(surface.rows[1_458_000:, [0, 1, 3]]).all()
    np.testing.assert_array_equal(surface.albedo, 0)


def test_what_is_no_merl_file_is_refused_in_one_line(tmp_path):
    with pytest.raises(InputError, match="cannot be read: No such file"):
        read_measured_surface(tmp_path / "none.binary")
    file = write_model(tmp_path, "cut", matte())
    content = file.read_bytes()
    file.write_bytes(content[:-8])
    with pytest.raises(InputError, match="Is it truncated"):
        read_measured_surface(file)
    file.write_bytes(struct.pack("<3i", 90, 180, 90) + content[12:])
    with pytest.raises(InputError, match="90 x 180 x 90 cells"):
        read_measured_surface(file)
    file.write_bytes(content[:12] + struct.pack("<d", float("nan")) + content[20:])
    with pytest.raises(InputError, match="not finite"):
        read_measured_surface(file)
