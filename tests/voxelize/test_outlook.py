"""The outlook comes true, within what a sample of tiles can tell, and leaves nothing behind."""

from __future__ import annotations

import pytest

from weft.files.errors import InputError
from weft.voxelize.config import VoxelizeConfig
from weft.voxelize.openvdb_library import library_version
from weft.voxelize.outlook import foresee
from weft.voxelize.stream import voxelize_to_files

pytestmark = pytest.mark.skipif(library_version() is None, reason="weft was installed without OpenVDB")


@pytest.mark.parametrize("seconds", [0.0, 60.0])
def test_outlook_is_what_comes(fibers, tmp_path, seconds):
    config = VoxelizeConfig(voxel_size_mm=0.03, tile_voxels=32)
    outlook = foresee(config, fibers, seconds=seconds)
    made = voxelize_to_files(config, fibers, [tmp_path / "a.vdb"])
    size = (tmp_path / "a.vdb").stat().st_size
    assert outlook.tile_count == made.report.tile_count
    assert outlook.brick_count_at_most >= made.brick_count
    # all tiles tried say it exactly; a few do to about a factor
    within = 1e-9 if outlook.tried_count == outlook.tile_count else 0.6
    assert outlook.tried_count == (outlook.tile_count if seconds else 4)
    assert outlook.brick_count == pytest.approx(made.brick_count, rel=within)
    assert outlook.voxel_count == pytest.approx(made.report.voxel_count, rel=within)
    if seconds:
        assert outlook.vdb_bytes == pytest.approx(size, rel=1e-3)
    assert len(outlook.lines()) == 5


def test_outlook_refuses_what_the_run_would(fibers):
    with pytest.raises(InputError, match="no fiber lies in it"):
        foresee(VoxelizeConfig(voxel_size_mm=0.1, region_mm=((50, 50, 50), (51, 51, 51))), fibers)


def test_voxel_size_may_follow_from_the_fibers(fibers, tmp_path):
    """The thinnest of the two types has a radius of 0.01 mm."""
    config = VoxelizeConfig(voxels_per_fiber_diameter=0.25)
    made = voxelize_to_files(config, fibers, [tmp_path / "a.vdb"])
    same = voxelize_to_files(VoxelizeConfig(voxel_size_mm=0.08), fibers, [tmp_path / "b.vdb"])
    assert made.content_sha256 == same.content_sha256


@pytest.mark.parametrize("sizes", [{}, {"voxel_size_mm": 0.1, "voxels_per_fiber_diameter": 1}])
def test_the_voxel_size_is_given_once(sizes):
    with pytest.raises(ValueError, match="either voxel_size_mm or voxels_per_fiber_diameter"):
        VoxelizeConfig(**sizes)
