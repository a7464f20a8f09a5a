"""The dye of voxels: what crosses a fiber takes its color, what it reflects does not."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from weft.files.errors import InputError
from weft.renderer.brick_pool import build_brick_pool
from weft.renderer.config import ConstantLight, OrthographicCamera, RenderConfig, StudioLight
from weft.renderer.pager import mean_colors
from weft.renderer.render import run
from weft.renderer.scene import IsotropicPhase
from weft.renderer.voxel_colors import LARGEST, WHITE, color_words, colors_of_words

from .statistics import Z_LIMIT, welch_z
from .test_kernel import CONFIG, GRIDS
from .test_pager import BRICK_MB, LOBES
from .test_transport import TABLE, furnace
from .volumes import random_grid, uniform_grid, volume

FIBER = TABLE["reference"]
DYE = tuple(((np.array([900, 300, 0]) / LARGEST) ** 2).tolist())
"""Exactly what a word can hold."""


def dyed(grid, color):
    """The grid with one color, or with the colors of an array, where it has fiber."""
    albedo = np.where(grid.density[..., None] > 0, np.float32(color), np.float32(0))
    return dataclasses.replace(grid, albedo=albedo.astype(np.float32))


def many_colored(grid, seed):
    return dyed(grid, np.random.default_rng(seed).random((*grid.density.shape, 3)))


def test_words_hold_colors_to_a_thousandth_and_white_exactly():
    color = np.random.default_rng(1).random((1000, 3))
    back = colors_of_words(color_words(color))
    assert np.abs(np.sqrt(back) - np.sqrt(color)).max() <= 0.5 / LARGEST + 1e-12
    assert (color_words(np.array([[1.0, 1.0, 1.0], [1.2, 1.0, 3.0]])) == WHITE).all()


@pytest.mark.parametrize("value", [-0.1, np.nan, np.inf])
def test_impossible_colors_are_refused(value):
    with pytest.raises(InputError, match="colors that are negative or not finite"):
        build_brick_pool([dyed(random_grid((1, 1, 1), seed=1), (0.5, value, 0.5))])


@pytest.mark.gl
def test_white_voxels_change_no_bit():
    usual = run(CONFIG, volume(*GRIDS), LOBES)
    white = run(CONFIG, volume(dyed(GRIDS[0], (1.0, 1.0, 1.0)), GRIDS[1]), LOBES)
    for name, layer in usual.layers.items():
        np.testing.assert_array_equal(layer, white.layers[name], err_msg=name)


@pytest.mark.gl
@pytest.mark.parametrize("lobes", [FIBER, dataclasses.replace(FIBER, longitudinal="symmetric")])
def test_dye_is_a_color_of_tt_and_its_square_of_trt(lobes):
    """A block of one dye is that of fibers whose own lobes have it; R stays white."""
    grid, square = uniform_grid((2, 2, 2), 0.3, (0, 1, 0)), tuple(np.square(DYE).tolist())
    config = RenderConfig(resolution=(24, 24), samples_per_pixel=64, lights=[StudioLight()])
    by_voxel = run(config, volume(dyed(grid, DYE)), {"a": lobes})
    own = dataclasses.replace(lobes, color_tt=DYE, color_trt=square)
    by_medium = run(config.model_copy(update={"seed": 5}), volume(grid), {"a": own})
    for channel in range(3):
        assert abs(welch_z(by_voxel, by_medium, channel=channel)) < Z_LIMIT
    for name in "RGB":
        np.testing.assert_allclose(
            by_voxel.layers[f"albedo.{name}"].max(), by_medium.layers[f"albedo.{name}"].max(), rtol=0.02
        )


@pytest.mark.gl
def test_light_and_phase_sampling_agree_on_dyed_fibers():
    """Chances of lobes follow the dye; were pdf and samples of different colors, these would differ."""
    grid = many_colored(random_grid((3, 3, 3), seed=21, fill=0.6, peak=1.0), 2)
    both, phase = furnace(FIBER, grid), furnace(FIBER, grid, sampling="phase", seed=2)
    for channel in range(3):
        assert abs(welch_z(both, phase, channel=channel)) < Z_LIMIT
    assert both.radiance.max() < 4
    assert both.radiance.mean() < 0.95


@pytest.mark.gl
def test_each_half_of_a_swatch_has_its_dye():
    grid = uniform_grid((2, 2, 1), 0.8, (0, 1, 0))
    left = grid.origins[:, None, :1] < 8
    swatch = dyed(grid, np.where(left, (0.81, 0.0, 0.0), (0.0, 0.0, 0.81)))
    config = RenderConfig(
        resolution=(32, 32), samples_per_pixel=16, camera=OrthographicCamera(), lights=[ConstantLight()]
    )
    red, _, blue = np.moveaxis(run(config, volume(swatch), {"a": IsotropicPhase()}).radiance, -1, 0)
    assert (red[8:24, 6:14].mean(), blue[8:24, 18:26].mean()) == pytest.approx((0.3, 0.3), abs=0.25)
    assert red[8:24, 6:14].min() > 10 * blue[8:24, 6:14].max()
    assert blue[8:24, 18:26].min() > 10 * red[8:24, 18:26].max()


@pytest.mark.gl
def test_overlapping_media_have_each_their_dye():
    grid = uniform_grid((2, 2, 2), 0.2, (0, 1, 0))
    config = RenderConfig(resolution=(24, 24), samples_per_pixel=64, lights=[ConstantLight()])
    albedo = {"a": (0.64, 0.0, 0.0), "b": (0.0, 0.0, 0.64)}
    by_voxel = run(config, volume(*(dyed(grid, color) for color in albedo.values())), {"a": IsotropicPhase()})
    own = {name: IsotropicPhase(albedo=color) for name, color in albedo.items()}
    by_medium = run(config.model_copy(update={"seed": 5}), volume(grid, grid), own)
    for channel in (0, 2):
        assert abs(welch_z(by_voxel, by_medium, channel=channel)) < Z_LIMIT


@pytest.mark.gl
def test_the_pool_of_bricks_changes_no_bit_of_colors(tmp_path):
    pytest.importorskip("weft.voxelize._openvdb", reason="OpenVDB is not installed")
    from weft.renderer.brick_file import open_brick_file
    from weft.voxelize.vdb import write_volume

    held = volume(many_colored(GRIDS[0], 3), GRIDS[1])
    usual = run(CONFIG, held, LOBES)
    write_volume(tmp_path / "volume.vdb", held)
    stored = open_brick_file(tmp_path / "volume.vdb")
    np.testing.assert_array_equal(stored.pool().voxels[:], build_brick_pool(list(held.grids.values())).voxels)
    other = run(CONFIG.model_copy(update={"brick_pool_mb": 10 * BRICK_MB}), stored, LOBES)
    assert other.statistics.brick_uploads > 0
    for name, layer in usual.layers.items():
        np.testing.assert_array_equal(layer, other.layers[name], err_msg=name)


def test_what_stands_for_all_outside_has_the_mean_dye():
    grid = many_colored(random_grid((2, 2, 2), seed=4), 5)
    found = mean_colors(build_brick_pool([grid]), 1)[0]
    weight = grid.density[..., None].astype(float)
    assert found == pytest.approx((weight * grid.albedo).sum(axis=(0, 1)) / weight.sum(), abs=3e-3)
