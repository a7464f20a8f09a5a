"""The mean color of the fibers in a voxel: weighted by length, in any order, kept by files."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from weft.voxelize import nanovdb, vdb
from weft.voxelize.config import VoxelizeConfig
from weft.voxelize.grid import FiberVolume
from weft.voxelize.openvdb_library import library_version
from weft.voxelize.stream import voxelize_to_files
from weft.voxelize.voxelize import run, voxelize_segments

COLORS = ((0.8, 0.1, 0.1), (0.1, 0.6, 0.2), (0.05, 0.1, 0.9))


def colored(fibers, **changes):
    """The same fibers with other colors."""
    from weft.fiber_model.fibers import run as lay_fibers
    from weft.fiber_model.yarns.yarns import YarnSet

    t = np.linspace(-2, 2, 9)
    yarns = YarnSet(
        points=np.stack([t, 0.4 * np.cos(t), 0.3 * np.sin(t)], axis=1),
        offsets=np.array([0, 9]),
        closed=np.array([False]),
        radius=np.array([0.4]),
        yarn_type=np.zeros(1, np.int32),
    )
    return lay_fibers(fibers.config.model_copy(update={"by_type": {}, **changes}), yarns)


@pytest.fixture(scope="module")
def plies(fibers):
    return colored(fibers, ply_colors=COLORS)


def albedo(fibers, size: float, **config) -> FiberVolume:
    return run(VoxelizeConfig(voxel_size_mm=size, albedo=True, **config), fibers)


@pytest.mark.parametrize("size", [0.018, 0.1])
def test_albedo_is_the_mean_over_the_fibers(plies, size):
    """Against grids of the body fibers of each ply alone, as explicit segments: thick lines, and thin."""
    from weft.fiber_model.fiber_curves import FiberSelection, export_curves

    bare = dataclasses.replace(plies)
    curves = export_curves(bare, FiberSelection())
    pairs = np.stack([curves.points[:-1], curves.points[1:]], axis=1)
    own = np.repeat(np.arange(curves.curve_count), np.diff(curves.offsets))
    within = own[:-1] == own[1:]
    color = curves.color[:-1][within]
    expected, total = {}, {}
    for value in np.unique(color, axis=0):
        part = pairs[within][(color == value).all(axis=1)]
        grid = voxelize_segments(VoxelizeConfig(voxel_size_mm=size), part, fiber_radius_mm=0.01).grids[
            "fiber"
        ]
        for origin, density in zip(grid.origins.tolist(), grid.density.astype(float), strict=True):
            place = tuple(origin)
            expected[place] = expected.get(place, 0) + density[:, None] * value
            total[place] = total.get(place, 0) + density[:, None]
    found = albedo(plies, size).grids["yarn"]
    checked = 0
    for origin, mean, density in zip(found.origins.tolist(), found.albedo, found.density, strict=True):
        sure = density > 1e-3 * found.density.max()
        truth = expected[tuple(origin)][sure] / total[tuple(origin)][sure]
        assert np.abs(mean[sure] - truth).max(initial=0) < 2e-3
        assert not mean[density == 0].any()
        checked += int(sure.sum())
    assert checked > 1000
    assert len(np.unique(np.round(found.albedo[found.density > 0], 2), axis=0)) > 50


def test_one_color_is_that_color_everywhere(fibers):
    volume = albedo(colored(fibers, ply_colors=(COLORS[0],)), 0.06)
    grid = volume.grids["yarn"]
    assert np.abs(grid.albedo[grid.density > 0] - np.array(COLORS[0])).max() < 1e-3
    white = albedo(colored(fibers), 0.06).grids["yarn"]
    assert (white.albedo[white.density > 0] == 1).all()


def test_bits_do_not_depend_on_tiles_or_workers(plies):
    hashes = {
        run(
            VoxelizeConfig(voxel_size_mm=0.05, albedo=True, tile_voxels=tile), plies, worker_count=n
        ).content_sha256
        for tile, n in ((128, 1), (16, 2), (40, 3))
    }
    assert len(hashes) == 1
    assert albedo(plies, 0.05).content_sha256 in hashes


@pytest.mark.skipif(library_version() is None, reason="weft was installed without OpenVDB")
@pytest.mark.parametrize("asked", [True, None])
def test_files_keep_it(plies, tmp_path, asked):
    config = VoxelizeConfig(voxel_size_mm=0.08, albedo=asked, levels=1, second_moment=True)
    made = voxelize_to_files(config, plies, [tmp_path / "a.vdb", tmp_path / "a.nvdb"])
    expected = run(config, plies)
    for read in (vdb.read_volume(tmp_path / "a.vdb"), nanovdb.read_volume(tmp_path / "a.nvdb")):
        assert np.array_equal(read.grids["yarn"].albedo, expected.grids["yarn"].albedo)
        assert read.content_sha256 == made.content_sha256 == expected.content_sha256
    names = {grid["name"] for grid in vdb.read_summaries(tmp_path / "a.vdb")}
    assert "albedo" in names
    # coarser levels carry the mean, in both of their lobes together
    coarse = vdb.read_volume(tmp_path / "a_level1.vdb")
    np.testing.assert_allclose(mean_albedo(coarse), mean_albedo(expected), rtol=1e-4)


def mean_albedo(volume):
    """Weighted by density, over all media."""
    grids = volume.grids.values()
    total = sum(np.einsum("bv,bvc->c", grid.density.astype(float), grid.albedo) for grid in grids)
    return total / sum(grid.density.sum(dtype=float) for grid in grids)


def test_colors_are_stored_where_there_are_any(fibers, plies):
    plain = VoxelizeConfig(voxel_size_mm=0.1)
    assert run(plain, plies).grids["yarn"].albedo is not None
    assert run(plain, colored(fibers)).grids["yarn"].albedo is None
    assert run(VoxelizeConfig(voxel_size_mm=0.1, albedo=False), plies).grids["yarn"].albedo is None
