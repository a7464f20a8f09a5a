"""Coarser levels beside a volume on the disk: those of the volume in memory, complete, and each a volume."""

from __future__ import annotations

import pytest

from weft.voxelize import nanovdb, vdb
from weft.voxelize.config import VoxelizeConfig
from weft.voxelize.grid_files import level_path
from weft.voxelize.level_of_detail import coarsen
from weft.voxelize.openvdb_library import library_version
from weft.voxelize.stream import voxelize_to_files
from weft.voxelize.voxelize import run

pytestmark = pytest.mark.skipif(library_version() is None, reason="weft was installed without OpenVDB")


@pytest.mark.parametrize("lobes", [1, 2])
def test_levels_are_those_of_the_volume_in_memory(fibers, tmp_path, lobes):
    config = VoxelizeConfig(voxel_size_mm=0.06, tile_voxels=32, levels=2, level_lobes=lobes)
    path = tmp_path / "volume.vdb"
    made = voxelize_to_files(config, fibers, [path, path.with_suffix(".nvdb")], worker_count=2)
    assert len(list(tmp_path.iterdir())) == 6
    fine = run(config, fibers)
    for report in made.levels:
        expected = coarsen(fine, lobes=lobes, factor=2**report.level)
        for read, suffix in ((vdb.read_volume, ".vdb"), (nanovdb.read_volume, ".nvdb")):
            level = read(level_path(path.with_suffix(suffix), report.level))
            assert level.content_sha256 == expected.content_sha256 == report.content_sha256
            assert level.about["level"] == report.level
            assert level.about["finest_content_sha256"] == made.content_sha256
            assert level.about["extinction_error_rms"] == report.extinction_error_rms
        assert report.fiber_length_mm == pytest.approx(fine.fiber_length_mm, rel=1e-5)
        assert report.voxel_size_mm == pytest.approx(0.06 * 2**report.level)
        assert (report.brick_count, report.voxel_count) == (expected.brick_count, expected.voxel_count)
    # one lobe of crossing yarns, each its own medium, is off by a few percent; two by less
    first, second = (report.extinction_error_rms for report in made.levels)
    assert 0 < first < second < (0.15 if lobes == 1 else 0.05)


def test_levels_do_not_depend_on_workers_or_tiles(fibers, tmp_path):
    hashes = set()
    for tile, workers in ((16, 1), (64, 2)):
        config = VoxelizeConfig(voxel_size_mm=0.06, tile_voxels=tile, levels=1)
        made = voxelize_to_files(config, fibers, [tmp_path / "volume.vdb"], worker_count=workers)
        hashes.add((made.levels[0].content_sha256, made.levels[0].extinction_error_rms))
        hashes.add((tmp_path / "volume_level1.vdb").read_bytes())
    assert len(hashes) == 2
