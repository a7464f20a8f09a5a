from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from weft.voxelize.grid import FiberGrid, FiberVolume


def test_mask_bits_follow_openvdb_leaves(make_grid):
    grid = make_grid(0, 5)
    for x, y, z in [(0, 0, 0), (1, 2, 3), (7, 7, 7), (3, 0, 6)]:
        bit = grid.masks[:, x] >> np.uint64(y * 8 + z) & np.uint64(1)
        assert np.array_equal(bit.astype(bool), grid.density[:, (x * 8 + y) * 8 + z] > 0)


def test_fiber_length_is_density_over_cross_section(make_grid):
    grid = make_grid(1, 3)
    expected = grid.density.sum(dtype=np.float64) * 0.06**3 / (math.pi * 0.008**2)
    assert grid.fiber_length_mm == pytest.approx(expected, rel=1e-12)


def test_bounds_enclose_whole_bricks(make_grid):
    grid = make_grid(2, 6)
    assert np.allclose(grid.bounds_mm[0], grid.origins.min(axis=0) * 0.06)
    assert np.allclose(grid.bounds_mm[1], (grid.origins.max(axis=0) + 8) * 0.06)


def test_hash_sees_every_part(make_grid):
    grid = make_grid(3, 4)
    hashes = {FiberVolume({"yarn": grid}).content_sha256, FiberVolume({"other": grid}).content_sha256}
    for name in ("density", "direction", "origins"):
        changed = getattr(grid, name).copy()
        changed.reshape(-1).view(np.uint8)[-4 if name != "origins" else -3] ^= 1 if name != "origins" else 4
        hashes.add(FiberVolume({"yarn": replace(grid, **{name: changed})}).content_sha256)
    hashes.add(FiberVolume({"yarn": replace(grid, voxel_size_mm=0.07)}).content_sha256)
    hashes.add(FiberVolume({"yarn": replace(grid, fiber_radius_mm=0.009)}).content_sha256)
    assert len(hashes) == 7


def test_hash_sees_the_order_of_media(make_grid):
    a, b = make_grid(4, 2), make_grid(5, 2)
    assert FiberVolume({"a": a, "b": b}).content_sha256 != FiberVolume({"b": b, "a": a}).content_sha256


@pytest.mark.parametrize(
    ("field", "spoil", "message"),
    [
        ("origins", lambda a: a + 1, "multiples of 8"),
        ("origins", lambda a: a[::-1].copy(), "not sorted"),
        ("origins", lambda a: a.astype(np.int64), "expected int32"),
        ("density", lambda a: a[:, :100], "expected float32"),
        ("direction", lambda a: a[:-1], "expected float32"),
        ("voxel_size_mm", lambda a: math.nan, "positive and finite"),
        ("fiber_radius_mm", lambda a: 0.0, "positive and finite"),
    ],
)
def test_malformed_grids_are_refused(make_grid, field, spoil, message):
    grid = make_grid(6, 4)
    with pytest.raises(ValueError, match=message):
        replace(grid, **{field: spoil(getattr(grid, field))})


@pytest.mark.parametrize("value", [-1.0, np.nan, np.inf])
def test_impossible_densities_are_found(make_grid, value):
    grid = make_grid(7, 2)
    grid.check_values()
    density = grid.density.copy()
    density[0, np.flatnonzero(density[0])[0]] = value
    with pytest.raises(ValueError, match="density"):
        replace(grid, density=density).check_values()


def test_directions_that_are_not_unit_are_found(make_grid):
    grid = make_grid(8, 2)
    direction = grid.direction * np.float32(1.01)
    with pytest.raises(ValueError, match="unit"):
        replace(grid, direction=direction).check_values()


def test_media_share_their_voxels(make_grid):
    with pytest.raises(ValueError, match="voxel sizes"):
        FiberVolume({"a": make_grid(0, 1), "b": replace(make_grid(1, 1), voxel_size_mm=0.1)})
    with pytest.raises(ValueError, match="at least one"):
        FiberVolume({})


def test_an_empty_grid_is_a_grid(make_grid):
    empty = make_grid(0, 0)
    assert isinstance(empty, FiberGrid)
    assert empty.brick_count == empty.voxel_count == empty.fiber_length_mm == 0
    assert np.array_equal(FiberVolume({"a": empty}).bounds_mm, np.zeros((2, 3)))
