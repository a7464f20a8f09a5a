"""Mitsuba reads our crops, and its SGGX has our extinction."""

from __future__ import annotations

import math

import numpy as np
import pytest

from weft.files.errors import InputError
from weft.voxelize.config import VoxelizeConfig
from weft.voxelize.mitsuba_vol import write_vol
from weft.voxelize.voxelize import run

BOX = ((-1.0, -0.4, -0.3), (0.6, 0.8, 0.7))


@pytest.fixture(scope="module")
def volume(fibers):
    return run(VoxelizeConfig(voxel_size_mm=0.1, second_moment=True), fibers)


def test_mitsuba_finds_our_extinction(volume, tmp_path):
    mitsuba = pytest.importorskip("mitsuba")
    mitsuba.set_variant("scalar_rgb")
    write_vol(tmp_path / "sigma.vol", tmp_path / "sggx.vol", volume, BOX)
    sigma = np.array(mitsuba.VolumeGrid(str(tmp_path / "sigma.vol")))
    sggx = np.array(mitsuba.VolumeGrid(str(tmp_path / "sggx.vol")))
    assert sigma.shape[:3] == (10, 12, 16)
    assert sggx.shape == (10, 12, 16, 6)
    box = np.frombuffer((tmp_path / "sigma.vol").read_bytes()[24:48], "<f4").reshape(2, 3)
    assert np.allclose(box, BOX, atol=1e-6)
    w = np.array([0.48, -0.6, 0.64])
    pairs = np.array([w[0] ** 2, w[1] ** 2, w[2] ** 2, 2 * w[0] * w[1], 2 * w[0] * w[2], 2 * w[1] * w[2]])
    found = sigma.reshape(10, 12, 16) * np.sqrt(sggx @ pairs)
    for place in [(3, 4, 5), (8, 6, 3), (10, 4, 3), (0, 0, 0)]:
        assert found[place[::-1]] == pytest.approx(
            at(volume, np.array(place) - np.array([10, 4, 3]), w), rel=1e-4, abs=1e-6
        )
    assert found.max() > 1


def at(volume, voxel, w: np.ndarray) -> float:
    """sigma_t of all media in one voxel: their T together, weighted by their extinction."""
    total, along = 0.0, 0.0
    for grid in volume.grids.values():
        row = np.flatnonzero((grid.origins == voxel // 8 * 8).all(axis=1))
        if not len(row):
            continue
        local = int((voxel % 8) @ [64, 8, 1])
        sigma = 2 * float(grid.density[row[0], local]) / (math.pi * grid.fiber_radius_mm)
        off = grid.moment_off[row[0], local] @ (w[[0, 0, 1]] * w[[1, 2, 2]])
        total += sigma
        along += sigma * float(grid.moment_diag[row[0], local] @ w**2 + 2 * off)
    return total * math.sqrt(max(1 - along / total, 0)) if total else 0.0


def test_too_large_a_box_is_refused(volume, tmp_path):
    with pytest.raises(InputError, match="smaller box"):
        write_vol(tmp_path / "a.vol", tmp_path / "b.vol", volume, ((-100, -100, -100), (100, 100, 100)))
    assert not list(tmp_path.iterdir())
