"""Lights: the alias table is exact, samples follow the density evaluated, directions are right."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from weft.files.errors import InputError
from weft.renderer import environment
from weft.renderer.config import ConstantLight, DirectionalLight, EnvironmentLight, SkyLight, StudioLight
from weft.renderer.environment import MAX_ROWS, load_environment, texel_directions, texel_solid_angles
from weft.renderer.image import write_exr
from weft.renderer.lights import LightTable, alias_table, build_light_table

from .probe import probe

AXES = np.eye(3)

PRELUDE = """
layout(std430, binding = 2) readonly buffer Lights { vec4 lights[]; };
uniform ivec2 environment_size;
uniform uint light_count;
uniform vec4 directional_lights[16];
vec3 sample_light(uvec2 choice, vec2 u, out vec3 value, out float pdf) {
    LightSample s = light_sample(choice, u, vec3(0.0));
    value = s.value;
    pdf = s.pdf;
    return s.direction;
}
"""


def light_probe(table, signature):
    rows = len(table.environment)
    pieces = PRELUDE.split("vec3 sample_light")
    uniforms = {"environment_size": (2 * rows, rows)}
    if "sample_light" in signature:
        uniforms |= {
            "light_count": len(table.entries),
            "directional_lights": [tuple(row) for row in table.directions.tolist()],
        }
    return probe(
        [],
        signature,
        prelude=pieces[0] + '\n#include "light/lights.glsl"\n' + "vec3 sample_light" + pieces[1],
        blocks={2: table.entries},
        uniforms=uniforms,
        constants={"LOCAL_LIGHTS": 0},
    )


def random_words(seed, count):
    return np.random.default_rng(seed).integers(0, 2**32, (count, 2), dtype=np.uint32)


def checkered_environment(tmp_path, rows=6):
    rng = np.random.default_rng(3)
    picture = (rng.random((rows, 2 * rows, 3)) ** 4 * 10).astype(np.float32)
    picture[0, 0] = 0
    write_exr(tmp_path / "sky.exr", dict(zip("RGB", np.moveaxis(picture, -1, 0), strict=True)), {})
    return picture, tmp_path / "sky.exr"


@pytest.mark.parametrize("count", [1, 2, 7, 5000])
def test_alias_table_is_exact(count):
    probability = np.random.default_rng(count).random(count) ** 6
    probability[:: max(count // 3, 2)] = 0 if count > 2 else probability[0]
    probability /= probability.sum()
    threshold, alias = alias_table(probability)
    chance = threshold / count
    np.add.at(chance, alias, (1 - threshold) / count)
    np.testing.assert_allclose(chance, probability, atol=1e-12)


def test_solid_angles_sum_to_the_sphere():
    assert texel_solid_angles(37).sum() * 74 == pytest.approx(4 * np.pi, rel=1e-12)


@pytest.mark.gl
@pytest.mark.parametrize("compensated", [False, True])
def test_samples_follow_the_density(tmp_path, compensated):
    """Chi-square of texels, directional light and no light against the table, error probability 1e-4."""
    picture, path = checkered_environment(tmp_path)
    lights = [EnvironmentLight(file=path), DirectionalLight(direction=(0, 0, 1), irradiance=(3, 3, 3))]
    table = build_light_table(lights, AXES, compensated=compensated)
    sample = light_probe(table, "vec3 sample_light(uvec2 choice, vec2 u, out vec3 value, out float pdf)")
    count = 400_000
    u = np.random.default_rng(2).random((count, 2), np.float32)
    direction, value, pdf = sample(random_words(1, count), u)
    on_sky = pdf > 0
    rows = len(picture)
    row = np.clip((np.arccos(direction[:, 1]) / np.pi * rows).astype(int), 0, rows - 1)
    azimuth = np.arctan2(direction[:, 0], -direction[:, 2]) % (2 * np.pi)
    column = np.clip((azimuth / np.pi * rows).astype(int), 0, 2 * rows - 1)
    seen = np.bincount((row * 2 * rows + column)[on_sky], minlength=2 * rows * rows)
    lit = value.any(axis=1)
    seen = np.append(seen, [(~on_sky & lit).sum(), (~on_sky & ~lit).sum()])
    measure = np.append(np.repeat(texel_solid_angles(rows), 2 * rows), [1.0, 1.0])
    expected = table.entries[:, 3] * measure * count
    # an edge is rounded differently here and there: a sample on it may be counted one texel off
    big = expected > 20
    statistic = ((seen - expected)[big] ** 2 / expected[big]).sum()
    assert stats.chi2.sf(statistic, big.sum() - 1) > 1e-4
    assert seen[expected == 0].sum() == 0


def test_only_what_is_brighter_than_the_mean_is_looked_for(tmp_path):
    """And as often as that is of all light; what it lacks is the chance of no light at all."""
    picture, path = checkered_environment(tmp_path)
    sun = DirectionalLight(direction=(0, 0, 1), irradiance=(3, 3, 3))
    table = build_light_table([EnvironmentLight(file=path), sun], AXES, compensated=True)
    luminance = picture.reshape(-1, 3) @ environment.LUMINANCE
    solid_angle = np.repeat(texel_solid_angles(len(picture)), 2 * len(picture))
    mean = (luminance * solid_angle).sum() / (4 * np.pi)
    total = (luminance * solid_angle).sum() + 3
    texels = len(luminance)
    np.testing.assert_allclose(
        table.entries[:texels, 3], np.maximum(luminance - mean, 0) / total, rtol=1e-4, atol=1e-6
    )
    assert table.entries[texels, 3] == pytest.approx(3 / total)
    chances = table.entries[:texels, 3] @ solid_angle + table.entries[texels:, 3].sum()
    assert chances == pytest.approx(1, rel=1e-5)


def test_constant_light_is_never_looked_for():
    entries = build_light_table([ConstantLight(radiance=(0.3, 0.7, 0.1))], AXES, compensated=True).entries
    assert entries[:-1, 3].max() == 0
    assert entries[-1, 3] == 1
    assert not entries[-1, :3].any()


@pytest.mark.gl
def test_entries_are_chosen_evenly():
    """At the borders between entries, where 32 bits alone would give one entry more numbers than another."""
    count = 3_000_001
    entries = np.zeros((count, 8), np.float32)
    entries[:, 3], entries[:, 4] = np.arange(count) % 2**20, 1
    rows = 1225  # 2 rows^2 is more than count: all are texels
    table = LightTable(np.zeros((rows, 2 * rows, 3), np.float32), np.zeros((16, 4), np.float32), entries)
    sample = light_probe(table, "vec3 sample_light(uvec2 choice, vec2 u, out vec3 value, out float pdf)")
    borders = [-(-(k << 64) // count) for k in range(1, count, 999)]
    for offset, step in ((0, 0), (-1, -1)):  # the first number of entry k, and the last of the one before
        words = np.array([((b + offset) >> 32, (b + offset) & 0xFFFFFFFF) for b in borders], np.uint32)
        chosen = sample(words, np.full((len(words), 2), 0.5, np.float32))[2]
        np.testing.assert_array_equal(chosen, (np.arange(1, count, 999) + step) % 2**20)


@pytest.mark.gl
def test_value_is_radiance_over_density(tmp_path):
    """What a sample carries is what evaluation says about its direction."""
    _, path = checkered_environment(tmp_path)
    table = build_light_table([EnvironmentLight(file=path)], AXES)
    sample = light_probe(table, "vec3 sample_light(uvec2 choice, vec2 u, out vec3 value, out float pdf)")
    evaluate = light_probe(table, "vec4 environment_eval(vec3 direction)")
    u = np.random.default_rng(4).random((20_000, 2), np.float32) * 0.98 + 0.01
    direction, value, pdf = sample(random_words(3, 20_000), u)
    evaluated = evaluate(direction)
    np.testing.assert_allclose(evaluated[:, 3], pdf, rtol=1e-6)
    np.testing.assert_allclose(value * pdf[:, None], evaluated[:, :3], rtol=1e-5, atol=1e-6)


@pytest.mark.gl
def test_samples_of_a_large_picture_are_found_in_their_texel():
    """Both directions of the map agree to 1e-3 of the texels of the largest picture, at the poles too."""
    rows = MAX_ROWS
    number = np.arange(2 * rows**2, dtype=np.uint32)
    entries = np.zeros((len(number), 8), np.float32)
    entries[:, 3], entries[:, 4], entries[:, 5] = number, 1, number.view(np.float32)
    table = LightTable(np.zeros((rows, 2 * rows, 3), np.float32), np.zeros((16, 4), np.float32), entries)
    sample = light_probe(table, "vec3 sample_light(uvec2 choice, vec2 u, out vec3 value, out float pdf)")
    evaluate = light_probe(table, "vec4 environment_eval(vec3 direction)")
    first, last = slice(0, 8 * rows), slice(-8 * rows, None)  # four rows each
    for places in (slice(None), first, last):
        texel = np.random.default_rng(6).choice(number[places], 200_000)
        choice = np.stack([texel * np.uint32(2**32 // len(number)), np.zeros_like(texel)], axis=1)
        direction, _, chosen = sample(choice, np.random.default_rng(7).random((len(texel), 2), np.float32))
        found = evaluate(direction)[:, 3]
        np.testing.assert_array_equal(chosen, texel)
        assert (found // (2 * rows) != texel // (2 * rows)).mean() < 1e-3
        assert (found % (2 * rows) != texel % (2 * rows)).mean() < 1e-3


@pytest.mark.gl
def test_texels_lie_where_the_picture_says():
    table = build_light_table([SkyLight(zenith=(0, 0, 9), horizon=(1, 1, 1), ground=(0.5, 0, 0))], AXES)
    evaluate = light_probe(table, "vec4 environment_eval(vec3 direction)")
    rows = len(table.environment)
    directions = texel_directions(rows)
    np.testing.assert_array_equal(evaluate(directions)[..., :3], table.environment)
    up, down = evaluate(np.array([[0.0, 1, 0], [0, -1, 0]]))
    assert up[2] > 8
    assert tuple(down[:3]) == (0.5, 0, 0)


def test_rotation_is_counterclockwise_from_above(tmp_path):
    rows = 8
    picture = np.zeros((rows, 2 * rows, 3), np.float32)
    picture[4, 12] = 1  # at azimuth 3/4 turn from -z toward +x, which is -x
    write_exr(tmp_path / "lamp.exr", dict(zip("RGB", np.moveaxis(picture, -1, 0), strict=True)), {})

    def brightest(degrees):
        table = build_light_table([EnvironmentLight(file=tmp_path / "lamp.exr", rotation_deg=degrees)], AXES)
        return texel_directions(rows)[np.unravel_index(table.environment[..., 0].argmax(), (rows, 2 * rows))]

    assert brightest(0)[0] < -0.9
    assert brightest(90)[2] > 0.9  # from -x, counterclockwise seen from +y, comes +z


def test_all_lights_around_the_scene_add_up(tmp_path):
    picture, path = checkered_environment(tmp_path, rows=4)
    both = build_light_table(
        [EnvironmentLight(file=path, intensity=2), ConstantLight(radiance=(1, 2, 3))], AXES
    )
    np.testing.assert_allclose(both.environment, 2 * picture + [1, 2, 3], rtol=1e-6)


def test_large_pictures_keep_their_light(tmp_path):
    rng = np.random.default_rng(8)
    picture = rng.random((2048, 4096)).astype(np.float32)
    write_exr(tmp_path / "large.exr", dict.fromkeys("RGB", picture), {})
    small = load_environment(tmp_path / "large.exr")
    assert small.shape == (1024, 2048, 3)
    before = (picture * texel_solid_angles(2048)[:, None]).sum()
    after = (small[..., 0] * texel_solid_angles(1024)[:, None]).sum()
    assert after == pytest.approx(before, rel=1e-6)


@pytest.mark.parametrize("rows", [7, 12, 37])
def test_pictures_of_any_size_become_small_and_keep_their_light(tmp_path, monkeypatch, rows):
    """Total light, and the light from each half space: halving alone would leave an odd height large."""
    monkeypatch.setattr(environment, "MAX_ROWS", 6)
    picture = np.random.default_rng(rows).random((rows, 2 * rows)).astype(np.float32)
    write_exr(tmp_path / "odd.exr", dict.fromkeys("RGB", picture), {})
    small = load_environment(tmp_path / "odd.exr")
    assert small.shape == (6, 12, 3)
    before, after = (p * texel_solid_angles(len(p))[:, None] for p in (picture, small[..., 0]))
    assert after.sum() == pytest.approx(before.sum(), rel=1e-6)
    assert after[:, :6].sum() == pytest.approx(before[:, :rows].sum(), rel=1e-6)
    if rows % 2 == 0:
        assert after[:3].sum() == pytest.approx(before[: rows // 2].sum(), rel=1e-6)


def test_pictures_of_different_sizes_add_up_without_losing_light(tmp_path):
    small, large = np.random.default_rng(1).random((5, 10)), np.random.default_rng(2).random((12, 24))
    for name, picture in (("small", small), ("large", large)):
        write_exr(tmp_path / f"{name}.exr", dict.fromkeys("RGB", picture), {})
    lights = [EnvironmentLight(file=tmp_path / f"{name}.exr") for name in ("small", "large")]
    total = build_light_table(lights, AXES).environment[..., 0]
    light = [(p * texel_solid_angles(len(p))[:, None]).sum() for p in (small, large, total)]
    assert light[2] == pytest.approx(light[0] + light[1], rel=1e-6)


def test_wrong_pictures_are_refused(tmp_path):
    write_exr(tmp_path / "square.exr", dict.fromkeys("RGB", np.ones((8, 8))), {})
    with pytest.raises(InputError, match=r"8 x 8; an environment must be twice as wide as high"):
        load_environment(tmp_path / "square.exr")
    write_exr(tmp_path / "hole.exr", dict.fromkeys("RGB", np.full((4, 8), np.nan)), {})
    with pytest.raises(InputError, match=r"negative or not finite"):
        load_environment(tmp_path / "hole.exr")


def test_rounding_below_zero_by_lossy_compression_is_cut_off(tmp_path):
    picture = np.ones((4, 8))
    picture[0, 0] = -1e-5
    write_exr(tmp_path / "lossy.exr", dict.fromkeys("RGB", picture), {})
    assert load_environment(tmp_path / "lossy.exr").min() == 0
    write_exr(tmp_path / "normals.exr", dict.fromkeys("RGB", np.linspace(-1, 1.2, 32).reshape(4, 8)), {})
    with pytest.raises(InputError, match=r"negative or not finite"):
        load_environment(tmp_path / "normals.exr")


def test_studio_follows_the_camera():
    """Turning the camera turns the softboxes with it."""
    front = build_light_table([StudioLight()], AXES).environment
    turned = build_light_table([StudioLight()], np.array([[0, 0, -1], [0, 1, 0], [1, 0, 0]])).environment
    quarter = front.shape[1] // 4
    difference = min(np.abs(np.roll(front, shift, axis=1) - turned).mean() for shift in (quarter, -quarter))
    assert difference < 1e-3 * front.mean()


def test_directional_lights_may_be_relative_to_the_camera():
    axes = np.array([[0, 0, -1], [0, 1, 0], [1, 0, 0]])
    table = build_light_table([DirectionalLight(direction=(0, 0, 2), relative_to="camera")], axes)
    np.testing.assert_allclose(table.directions[0], [1, 0, 0, 0])
