"""The dye of coarser levels: the mean of what is drawn at the finest, weighted by density."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from weft.voxelize import nanovdb, vdb
from weft.voxelize.config import VoxelizeConfig
from weft.voxelize.grid import FiberGrid, FiberVolume
from weft.voxelize.grid_files import level_path
from weft.voxelize.level_of_detail import coarsen
from weft.voxelize.openvdb_library import library_version
from weft.voxelize.stream import voxelize_to_files
from weft.voxelize.voxelize import run

from .test_albedo import COLORS, colored


def dyed(grid: FiberGrid, seed: int = 3) -> FiberVolume:
    """In random colors, some of them above 1."""
    albedo = np.random.default_rng(seed).uniform(0, 1.1, (*grid.density.shape, 3)).astype(np.float32)
    return FiberVolume(
        {"fiber": dataclasses.replace(grid, albedo=np.where(grid.density[..., None] > 0, albedo, 0))}
    )


def dye_by_voxel(volume: FiberVolume, factor: int) -> dict[tuple[int, ...], np.ndarray]:
    """Density and density times dye, summed over media in voxels `factor` times as large."""
    sums: dict[tuple[int, ...], np.ndarray] = {}
    local = np.stack(np.unravel_index(np.arange(512), (8, 8, 8)), axis=1)
    for grid in volume.grids.values():
        brick, voxel = np.nonzero(grid.density)
        weight = grid.density[brick, voxel].astype(np.float64)[:, None]
        color = np.minimum(grid.albedo[brick, voxel], 1)
        places = (grid.origins[brick] + local[voxel]) // factor
        for place, value in zip(places.tolist(), np.hstack([weight, weight * color]), strict=True):
            sums[tuple(place)] = sums.get(tuple(place), 0.0) + value
    return sums


@pytest.mark.parametrize("lobes", [1, 2])
@pytest.mark.parametrize("factor", [2, 8])
def test_dye_is_the_mean_weighted_by_density(make_grid, factor, lobes):
    """Of one lobe voxel by voxel, with one direction; of two, what both hold together."""
    fine = dyed(make_grid(4, 6))
    expected = dye_by_voxel(fine, factor)
    found = dye_by_voxel(coarsen(fine, lobes=lobes, factor=factor), 1)
    assert found.keys() == expected.keys()
    for place, sums in expected.items():
        np.testing.assert_allclose(found[place] * factor**3, sums, rtol=2e-6)
    assert len(expected) > 6 * 64 / factor**3


def test_lobes_keep_the_dyes_of_warp_and_weft_apart():
    """Red along x and blue along y in the same coarse voxel; one lobe makes purple of them."""
    at = np.arange(512) & 1
    axis = np.where(at[:, None] == 0, np.float32([1, 0, 0]), np.float32([0, 1, 0]))
    dye = np.where(at[:, None] == 0, np.float32([0.9, 0.1, 0.1]), np.float32([0.1, 0.1, 0.8]))
    origins, density = np.zeros((1, 3), np.int32), np.full((1, 512), 0.3, np.float32)
    grid = FiberGrid(0.05, 0.01, origins, density, axis[None], albedo=dye[None])
    both = coarsen(FiberVolume({"fiber": grid}), lobes=2)
    for level in both.grids.values():
        held = level.density > 0
        red = np.abs(level.direction[held][:, 0]) > 0.99
        np.testing.assert_allclose(level.albedo[held], np.where(red[:, None], dye[0], dye[1]), atol=1e-6)
    one = coarsen(FiberVolume({"fiber": grid}), lobes=1).grids["fiber"]
    np.testing.assert_allclose(one.albedo[one.density > 0], np.tile([0.5, 0.1, 0.45], (64, 1)), atol=1e-6)


@pytest.mark.parametrize("factor", [2, 4, 32])
def test_one_dye_is_the_same_at_every_level(fibers, factor):
    dye = (0.13, 0.57, 0.9)
    fine = run(VoxelizeConfig(voxel_size_mm=0.05), colored(fibers, ply_colors=(dye,)))
    for grid in coarsen(fine, factor=factor).grids.values():
        held = grid.density > 0
        np.testing.assert_allclose(grid.albedo[held], np.tile(dye, (held.sum(), 1)), atol=2e-4)
        assert not grid.albedo[~held].any()


def test_levels_of_volumes_without_dye_have_none(make_grid):
    level = coarsen(FiberVolume({"fiber": make_grid(4, 30)}))
    assert all(grid.albedo is None for grid in level.grids.values())


@pytest.mark.skipif(library_version() is None, reason="weft was installed without OpenVDB")
def test_files_of_levels_keep_the_dye(fibers, tmp_path):
    plies = colored(fibers, ply_colors=COLORS)
    config = VoxelizeConfig(voxel_size_mm=0.06, tile_voxels=32, levels=2)
    path = tmp_path / "volume.vdb"
    made = voxelize_to_files(config, plies, [path, path.with_suffix(".nvdb")], worker_count=2)
    fine = run(config, plies)
    for report in made.levels:
        expected = coarsen(fine, factor=2**report.level)
        for read, suffix in ((vdb.read_volume, ".vdb"), (nanovdb.read_volume, ".nvdb")):
            level = read(level_path(path.with_suffix(suffix), report.level))
            assert level.content_sha256 == expected.content_sha256 == report.content_sha256
            for name, grid in expected.grids.items():
                assert np.array_equal(level.grids[name].albedo, grid.albedo)
