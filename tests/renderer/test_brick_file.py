"""Bricks on the disk are those in memory; files that are not whole, or of another volume, are not used."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from weft.files.errors import InputError
from weft.renderer.brick_file import open_brick_file
from weft.renderer.brick_pool import build_brick_pool
from weft.renderer.render import run
from weft.voxelize.vdb import write_volume

from .test_kernel import CONFIG, GRIDS
from .test_pager import BRICK_MB, LOBES
from .volumes import random_grid, volume

pytest.importorskip("weft.voxelize._openvdb", reason="OpenVDB is not installed")


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "volume.vdb"
    write_volume(path, volume(*GRIDS))
    return path


def test_bricks_on_the_disk_are_those_in_memory(file):
    stored, usual = open_brick_file(file), build_brick_pool(GRIDS)
    pool = stored.pool()
    for field in dataclasses.fields(usual):
        if field.name != "voxels":
            np.testing.assert_array_equal(getattr(pool, field.name), getattr(usual, field.name), field.name)
    some = np.random.default_rng(1).integers(0, len(usual.voxels), 50)
    np.testing.assert_array_equal(pool.voxels[some], usual.voxels[some])
    np.testing.assert_array_equal(pool.voxels[3:9], usual.voxels[3:9])
    np.testing.assert_array_equal(stored.bounds_mm, volume(*GRIDS).bounds_mm)
    assert stored.media == ("a", "b")


@pytest.mark.gl
def test_a_picture_from_the_disk_has_the_same_bits(file):
    usual = run(CONFIG, volume(*GRIDS), LOBES)
    for limit in (None, 5 * BRICK_MB):
        other = run(CONFIG.model_copy(update={"brick_pool_mb": limit}), open_brick_file(file), LOBES)
        for name, layer in usual.layers.items():
            np.testing.assert_array_equal(layer, other.layers[name], err_msg=name)


def test_it_is_made_once_and_again_for_another_volume(file):
    bricks = open_brick_file(file).path
    made = bricks.stat().st_mtime_ns
    assert open_brick_file(file).path.stat().st_mtime_ns == made
    write_volume(file, volume(random_grid((2, 2, 2), seed=9)))
    assert open_brick_file(file).brick_count == 8


def test_a_file_that_is_not_whole_is_made_anew(file):
    whole = open_brick_file(file).path.read_bytes()
    for damaged in (whole[:-1], whole[2048:]):
        open_brick_file(file).path.write_bytes(damaged)
        assert open_brick_file(file).path.read_bytes() == whole


def test_a_damaged_volume_is_refused_and_leaves_no_file(file):
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 1
    file.write_bytes(data)
    with pytest.raises(InputError):
        open_brick_file(file)
    assert not file.with_suffix(".bricks").exists()
