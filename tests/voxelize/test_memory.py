from __future__ import annotations

import re

import numpy as np
import pytest

from weft.files import machine_memory
from weft.files.errors import InputError
from weft.voxelize import memory
from weft.voxelize.config import VoxelizeConfig
from weft.voxelize.sources import FiberSource
from weft.voxelize.tiles import snap_region
from weft.voxelize.voxelize import run


@pytest.mark.parametrize("voxel_size_mm", [0.02, 0.05, 0.2])
def test_estimate_bounds_the_bricks(fibers, voxel_size_mm):
    source = FiberSource(fibers)
    bound = sum(
        memory.estimate_brick_count(
            source.bounds_mm[source.medium == medium],
            voxel_size_mm=voxel_size_mm,
            region=snap_region(None, voxel_size_mm),
        )
        for medium in range(2)
    )
    made = run(VoxelizeConfig(voxel_size_mm=voxel_size_mm), fibers).brick_count
    assert made <= bound <= 40 * made


def test_estimate_counts_overlapping_boxes_once():
    boxes = np.array([[[0, 0, 0], [7.5, 7.5, 7.5]]] * 100, np.float32) + 0.2
    everywhere = snap_region(None, 1.0)
    assert memory.estimate_brick_count(boxes, voxel_size_mm=1.0, region=everywhere) == 1


def test_estimate_stays_small_for_the_tiniest_voxels(fibers):
    bounds = fibers.stretch_bounds()
    counts = [
        memory.estimate_brick_count(bounds, voxel_size_mm=size, region=snap_region(None, size))
        for size in (1e-5, 1e-4, 1e-3)
    ]
    assert counts[0] / counts[1] == pytest.approx(1000, rel=0.3)
    assert counts[1] / counts[2] == pytest.approx(1000, rel=0.3)


def test_refusal_says_what_is_needed_and_what_to_change(fibers):
    with pytest.raises(InputError) as caught:
        run(VoxelizeConfig(voxel_size_mm=0.01, memory_mb=600), fibers)
    message = str(caught.value)
    assert re.fullmatch(
        r"voxelize: voxels of 0\.01 mm may need [\d.]+ GiB but 0\.586 GiB are available; "
        r"set voxelize\.voxel_size_mm to [\d.]+ or more, or a smaller voxelize\.region_mm, "
        r"or raise voxelize\.memory_mb\.",
        message,
    ), message
    advice = float(re.search(r"voxel_size_mm to ([\d.]+)", message)[1])
    run(VoxelizeConfig(voxel_size_mm=advice, memory_mb=600), fibers)


def test_refusal_when_the_machine_is_full(fibers, monkeypatch):
    monkeypatch.setattr(memory, "available_memory_bytes", lambda: 300 * 2**20)
    with pytest.raises(
        InputError, match=r"but 0\.293 GiB are available; set voxelize.voxel_size_mm to [\d.]+ or"
    ):
        run(VoxelizeConfig(voxel_size_mm=0.01), fibers)


def test_a_control_group_limits_the_memory(tmp_path, monkeypatch):
    (tmp_path / "memory.max").write_text("5000000\n")
    (tmp_path / "memory.current").write_text("3000000\n")
    monkeypatch.setattr(machine_memory, "CGROUP", tmp_path)
    assert machine_memory.available_memory_bytes() == 2_000_000
    (tmp_path / "memory.max").write_text("max\n")
    assert machine_memory.available_memory_bytes() > 2**26
