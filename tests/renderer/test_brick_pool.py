"""The pool keeps what the grids say: fiber volume, directions to 0.14 degrees, bounds that bound."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from weft.files.errors import InputError
from weft.renderer import brick_pool
from weft.renderer.brick_pool import DENSITY_LEVELS, EMPTY_CELL, build_brick_pool, empty_radius
from weft.renderer.direction_encoding import DIRECTION_BITS, decode_axis, encode_axis

from .volumes import brick_origins, random_grid, uniform_grid


def stored_density(pool):
    return (pool.voxels >> (2 * DIRECTION_BITS)) * pool.density_step[:, None].astype(np.float64)


def test_quantization_keeps_the_fiber_volume_of_every_brick():
    grid = random_grid((3, 3, 3), seed=1)
    stored = stored_density(build_brick_pool([grid])).sum(axis=1)
    np.testing.assert_allclose(stored, grid.density.sum(axis=1, dtype=np.float64), rtol=2e-7)


def test_quantized_density_is_within_a_level():
    """Half a level from rounding, and at most half from keeping the sum."""
    grid = random_grid((2, 2, 2), seed=2)
    error = np.abs(stored_density(build_brick_pool([grid])) - grid.density).max(axis=1)
    assert (error <= grid.density.max(axis=1) / DENSITY_LEVELS).all()


@pytest.mark.parametrize("density", [1e-30, 1e-37, 1e-42])
def test_hardly_any_fiber_is_harmless(density):
    """A sliver in a brick of its own: the scale of the levels must not overflow."""
    grid = uniform_grid((1, 1, 1), 0.0, (0, 1, 0))
    grid.density[0, 5] = density
    pool = build_brick_pool([grid])
    assert list(pool.majorant_level) == [DENSITY_LEVELS]
    assert (pool.voxels[0] >> (2 * DIRECTION_BITS) > 0).sum() == 1
    assert np.isfinite(pool.density_step).all()


def test_majorant_bounds_the_stored_values():
    pool = build_brick_pool([random_grid((2, 2, 2), seed=3)])
    levels = pool.voxels >> (2 * DIRECTION_BITS)
    assert (levels <= pool.majorant_level[:, None]).all()
    assert (levels.max(axis=1) == pool.majorant_level).all()


def test_direction_error_is_below_a_seventh_of_a_degree():
    axes = np.random.default_rng(4).normal(size=(200_000, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    cosine = np.abs((decode_axis(encode_axis(axes)).astype(np.float64) * axes).sum(axis=1))
    assert np.degrees(np.arccos(np.minimum(cosine, 1))).max() < 0.14


@pytest.mark.parametrize("axis", np.vstack([np.eye(3), -np.eye(3)]))
def test_coordinate_axes_are_exact(axis):
    assert abs(decode_axis(encode_axis(axis)) @ axis) == 1


def test_opposite_axes_are_one():
    axes = np.random.default_rng(5).normal(size=(1000, 3))
    np.testing.assert_array_equal(encode_axis(axes), encode_axis(-axes))


def test_empty_cells_know_the_empty_box_around_them():
    origins = brick_origins((9, 8, 7))
    keep = np.random.default_rng(6).random(len(origins)) < 0.01
    keep[[0, -1]] = True
    grid = uniform_grid((9, 8, 7), 0.1, (1, 0, 0))
    grid = dataclasses.replace(
        grid, origins=origins[keep], density=grid.density[keep], direction=grid.direction[keep]
    )
    cells = build_brick_pool([grid]).cells
    places = origins[keep] // 8
    for place in np.ndindex(cells.shape):
        distance = np.abs(places - place).max(axis=1).min()
        word = int(cells[place])
        assert (word < EMPTY_CELL) == (distance == 0)
        if distance:
            assert word & 0xFFFF == distance - 1


def test_empty_voxels_know_the_empty_box_around_them():
    grid = random_grid((1, 1, 1), seed=7, fill=0.004)
    word = build_brick_pool([grid]).voxels.reshape(8, 8, 8)
    occupied = np.argwhere(word >> (2 * DIRECTION_BITS))
    for voxel in np.ndindex(8, 8, 8):
        distance = np.abs(occupied - voxel).max(axis=1).min()
        if distance:
            assert word[voxel] == distance - 1


def test_bricks_of_one_cell_follow_each_other():
    one, two = random_grid((2, 2, 2), seed=8), random_grid((3, 1, 2), seed=9)
    pool = build_brick_pool([one, two])
    assert pool.layer_count == 2
    first, layers = pool.cells[0, 0, 0] & 0x0FFFFFFF, (pool.cells[0, 0, 0] >> 28) + 1
    assert layers == 2
    assert list(pool.medium[first : first + 2]) == [0, 1]


def test_volumes_far_from_the_origin_stay_small():
    grid = dataclasses.replace(random_grid((1, 1, 1), seed=1), origins=np.array([[-800, 8000, 16]], np.int32))
    pool = build_brick_pool([grid])
    assert pool.cells.shape == (1, 1, 1)
    np.testing.assert_array_equal(pool.origin, [-800, 8000, 16])


def test_bad_grids_are_refused_in_one_line():
    grid = random_grid((1, 1, 1), seed=1)
    bad = grid.density.copy()
    bad[0, 7] = np.nan
    with pytest.raises(InputError, match="medium 0 has densities that are negative or not finite"):
        build_brick_pool([dataclasses.replace(grid, density=bad)])
    astray = grid.direction.copy()
    astray[0, np.flatnonzero(grid.density[0])[3], 1] = np.nan
    with pytest.raises(InputError, match="medium 0 has directions that are not finite"):
        build_brick_pool([dataclasses.replace(grid, direction=astray)])
    empty = dataclasses.replace(
        grid, origins=grid.origins[:0], density=grid.density[:0], direction=grid.direction[:0]
    )
    with pytest.raises(InputError, match="the volume holds no fiber"):
        build_brick_pool([empty])


@pytest.mark.parametrize("small_grid", [0, brick_pool.SMALL_GRID], ids=["by scipy", "by growing"])
@pytest.mark.parametrize("share", [0.3, 0.02, 0.0])
def test_empty_boxes_reach_to_the_nearest_cell(share, small_grid, monkeypatch):
    """Found either way, against the distances to all occupied cells."""
    monkeypatch.setattr(brick_pool, "SMALL_GRID", small_grid)
    rng = np.random.default_rng(5)
    for shape in ((7, 12, 9), (1, 1, 30), (16, 2, 5)):
        occupied = rng.random(shape) < share
        occupied[tuple(rng.integers(shape))] = True
        apart = np.indices(shape).reshape(3, -1, 1) - np.argwhere(occupied).T[:, None]
        distance = np.abs(apart).max(axis=0).min(axis=1).reshape(shape)
        np.testing.assert_array_equal(empty_radius(occupied), np.maximum(distance - 1, 0))
