"""The stage: what comes out, what is saved, and what is refused."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from weft.files.errors import DeviceMemoryError, InputError
from weft.renderer import scene
from weft.renderer.brick_pool import build_brick_pool
from weft.renderer.config import ConstantLight, EnvironmentLight, OrthographicCamera, RenderConfig
from weft.renderer.gpu.buffers import reserve
from weft.renderer.gpu.context import shared_context
from weft.renderer.image import read_exr, write_exr
from weft.renderer.render import attributes, run, save
from weft.renderer.scene import IsotropicPhase
from weft.renderer.voxel_pages import MAX_VOXEL_PAGES, page_limit, voxel_pages_glsl

from .test_transport import TABLE
from .volumes import random_grid, uniform_grid, volume

pytestmark = pytest.mark.gl

CONFIG = RenderConfig(resolution=(16, 12), samples_per_pixel=4, seed=3, lights=[ConstantLight()])


@pytest.fixture(scope="module")
def result():
    return run(CONFIG, volume(uniform_grid((2, 2, 1), 0.5, (1, 2, 0))), {"a": TABLE["reference"]})


def test_saved_picture_holds_layers_and_origin(result, tmp_path):
    save(result, tmp_path / "cloth.exr")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["cloth.exr", "cloth.png"]
    channels, header = read_exr(tmp_path / "cloth.exr")
    wished = {"R", "G", "B", "A", "variance.R", "albedo.R", "T.X", "T.Y", "T.Z", "Z"}
    assert wished <= set(channels)
    assert all(data.shape == (12, 16) for data in channels.values())
    assert header["weft.samplesPerPixel"] == 4
    assert RenderConfig(**json.loads(header["weft.config"])) == CONFIG
    assert shared_context().info["GL_RENDERER"] in header["weft.device"]


def test_saved_picture_names_its_environment_without_the_machines_folders(result, tmp_path):
    write_exr(tmp_path / "sky.exr", dict.fromkeys("RGB", np.ones((4, 8))), {})
    lights = [EnvironmentLight(file=tmp_path / "sky.exr")]
    moved = dataclasses.replace(result, config=RenderConfig(lights=lights))
    header = attributes(moved)
    assert json.loads(str(header["weft.config"]))["lights"][0]["file"] == "sky.exr"
    assert str(tmp_path) not in repr(header)


def test_layers_describe_the_first_scattering(result):
    hit = result.layers["A"] == 1
    assert hit.any()
    assert not hit.all()
    axis = np.stack([result.layers[f"T.{c}"] for c in "XYZ"], axis=-1)[hit]
    np.testing.assert_allclose(axis, np.broadcast_to(np.array([1, 2, 0]) / np.sqrt(5), axis.shape), atol=2e-3)
    np.testing.assert_allclose(result.layers["albedo.G"][hit], 1, atol=1e-5)
    assert np.isinf(result.layers["Z"][result.layers["A"] == 0]).all()


@pytest.mark.parametrize("axis", [(1, 2, -2), (0, 1, 1), (2, -1, 2)])
def test_the_axis_layer_shows_the_fibers(axis):
    picture = run(CONFIG, volume(uniform_grid((2, 2, 1), 0.5, axis)), {"a": IsotropicPhase()})
    seen = np.stack([picture.layers[f"T.{c}"] for c in "XYZ"], axis=-1)
    hit = picture.layers["A"] > 0
    assert np.abs(seen[hit] @ np.array(axis) / np.linalg.norm(axis)).min() > 1 - 1e-5
    assert not seen[~hit].any()


def test_axes_across_x_do_not_cancel():
    """Two media lean a little to either side of y: their mean axis is y, not x, to which the vectors sum."""
    lean = [uniform_grid((2, 2, 1), 0.5, (0.1, side, 0)) for side in (1.0, -1.0)]
    picture = run(CONFIG.model_copy(update={"samples_per_pixel": 64}), volume(*lean), {"a": IsotropicPhase()})
    hit = picture.layers["A"] > 0.5
    axis = np.stack([picture.layers[f"T.{c}"] for c in "XYZ"], axis=-1)[hit]
    assert len(axis) > 20
    assert np.abs(axis[:, 1]).min() > 0.99
    assert axis[:, 0].min() >= 0


def test_depth_is_in_millimeters():
    config = CONFIG.model_copy(
        update={
            "camera": OrthographicCamera(
                position_mm=(0.4, 0.4, 10.0), target_mm=(0.4, 0.4, 0.0), frame_width_mm=0.1
            )
        }
    )
    dense = run(config, volume(uniform_grid((2, 2, 1), 500.0, (1, 0, 0))), {"a": IsotropicPhase((0, 0, 0))})
    np.testing.assert_allclose(dense.layers["Z"], 9.6, atol=1e-3)


def test_progress_reaches_the_end():
    calls = []
    run(
        CONFIG,
        volume(random_grid((1, 1, 1), seed=1)),
        {"a": TABLE["reference"]},
        progress=lambda *c: calls.append(c),
    )
    fraction, detail = calls[-1]
    assert fraction == 1
    assert "768 of 768 paths" in detail


def test_one_scattering_serves_all_media():
    grids = volume(random_grid((1, 1, 1), seed=1), random_grid((1, 1, 1), seed=2))
    assert run(CONFIG, grids, {"any": TABLE["reference"]}).statistics.paths == 768


def test_missing_scattering_is_named():
    grids = volume(random_grid((1, 1, 1), seed=1), random_grid((1, 1, 1), seed=2))
    with pytest.raises(InputError, match="no scattering for medium b; given are a, c"):
        run(CONFIG, grids, {"a": TABLE["reference"], "c": TABLE["reference"]})


def test_pages_of_voxels_make_the_same_picture(monkeypatch):
    """The same bricks spread over several buffers."""
    from weft.renderer import kernel

    monkeypatch.setattr(kernel, "bricks_per_page", lambda *_: 1)
    paged = run(CONFIG, volume(random_grid((2, 2, 2), seed=9)), {"a": TABLE["reference"]})
    monkeypatch.undo()
    whole = run(CONFIG, volume(random_grid((2, 2, 2), seed=9)), {"a": TABLE["reference"]})
    np.testing.assert_array_equal(paged.radiance, whole.radiance)


def test_too_many_bricks_are_refused(monkeypatch):
    from weft.renderer import kernel

    monkeypatch.setattr(kernel, "bricks_per_page", lambda *_: 1)
    with pytest.raises(DeviceMemoryError, match="27 bricks need 27 buffers"):
        run(CONFIG, volume(uniform_grid((3, 3, 3), 0.5, (1, 0, 0))), {"a": TABLE["reference"]})


def test_buffers_stay_within_what_the_driver_offers():
    least = {"GL_MAX_COMPUTE_SHADER_STORAGE_BLOCKS": 8, "GL_MAX_SHADER_STORAGE_BUFFER_BINDINGS": 8}
    assert page_limit(least) == page_limit({}) == 1
    assert page_limit(least | {"GL_MAX_COMPUTE_SHADER_STORAGE_BLOCKS": 16}) == 1
    assert page_limit(dict.fromkeys(least, 12)) == 5
    assert page_limit(dict.fromkeys(least, 96)) == MAX_VOXEL_PAGES


def test_memory_the_device_lacks_is_refused():
    with pytest.raises(DeviceMemoryError, match=r"need 70368744177664 bytes of .*, and \d+ are"):
        reserve(shared_context(), 2**46, name="a test")


def test_a_volume_too_wide_is_refused(monkeypatch):
    from weft.renderer import brick_pool

    monkeypatch.setattr(brick_pool, "MAX_CELLS", 7)
    with pytest.raises(DeviceMemoryError, match="spans"):
        build_brick_pool([uniform_grid((2, 2, 2), 0.1, (1, 0, 0))])


def test_scattering_kinds_do_not_mix():
    with pytest.raises(InputError, match="all be fibers, or none"):
        scene.build_phase_table(("a", "b"), {"a": TABLE["reference"], "b": IsotropicPhase()})


def test_page_function_covers_every_page():
    text = voxel_pages_glsl(3, 4)
    assert text.count("readonly buffer") == 3
    assert "slot >> 4u" in text
    assert "slot & 15u" in text
