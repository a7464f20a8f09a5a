"""A fiber thicker than a voxel fills it as a cylinder does, keeps its length, and becomes a line smoothly."""

from __future__ import annotations

import math

import numpy as np
import pytest

from weft.voxelize.config import VoxelizeConfig
from weft.voxelize.coverage import line_offsets, spread
from weft.voxelize.grid import FiberGrid
from weft.voxelize.voxelize import run, voxelize_segments

RADIUS = 0.01


def voxelize(segments: np.ndarray, voxel_size_mm: float, **config) -> FiberGrid:
    made = VoxelizeConfig(voxel_size_mm=voxel_size_mm, **config)
    return voxelize_segments(made, np.asarray(segments, np.float32), fiber_radius_mm=RADIUS).grids["fiber"]


def dense(grid: FiberGrid, low: int, high: int) -> np.ndarray:
    """Volume fraction of the voxels low <= i, j, k < high."""
    values = np.zeros((high - low,) * 3)
    local = np.stack(np.unravel_index(np.arange(512), (8, 8, 8)), axis=1)
    for origin, density in zip(grid.origins, grid.density, strict=True):
        place = origin + local - low
        kept = ((place >= 0) & (place < high - low)).all(axis=1)
        values[tuple(place[kept].T)] = density[kept]
    return values


def sampled_cylinder(axis: np.ndarray, through: np.ndarray, h: float, low: int, high: int) -> np.ndarray:
    """Part of each voxel that lies within RADIUS of a line, from 12^3 points in each."""
    fine = (np.arange((high - low) * 12) + 0.5) / 12 + low
    x, y, z = np.meshgrid(fine, fine, fine, indexing="ij")
    d = np.stack([x, y, z], axis=-1) * h - through
    squared = (d**2).sum(axis=-1) - (d @ axis) ** 2
    inside = (squared < RADIUS**2).reshape(high - low, 12, high - low, 12, high - low, 12)
    return inside.mean(axis=(1, 3, 5))


@pytest.mark.parametrize("voxels_per_diameter", [1.0, 2.0, 4.0])
@pytest.mark.parametrize("tilt", [(0, 0, 1), (1, 2, 3), (1, -1, -0.2)])
def test_voxels_hold_the_cylinder_volume(voxels_per_diameter, tilt):
    h = 2 * RADIUS / voxels_per_diameter
    axis = np.array(tilt) / np.linalg.norm(tilt)
    through = np.array([0.3, -0.2, 0.1]) * h
    found = dense(voxelize([[through - axis, through + axis]], h), -6, 6)
    expected = sampled_cylinder(axis, through, h, -6, 6)
    error = np.abs(found - expected).max(), np.sqrt(((found - expected) ** 2).sum() / (expected**2).sum())
    # rings meet voxel faces worst where the fiber runs along an axis
    assert error < ((0.08, 0.08) if tilt == (0, 0, 1) else (0.03, 0.015))
    assert error[1] < (0.08 if tilt == (0, 0, 1) else 0.015)


def test_one_line_would_not_do():
    """What the test above would see of a line: many times the volume that there is in a voxel."""
    h = RADIUS / 2
    line = math.pi * RADIUS**2 / h**2
    assert line > 12
    # 200 voxels from where it begins, float32 places a voxel's face to 1e-5 of its size
    segment = [[[0.1 * h, 0.1 * h, -1], [0.1 * h, 0.1 * h, 1]]]
    assert dense(voxelize(segment, h, fiber_shape="line"), -6, 6).max() == pytest.approx(line, rel=1e-4)
    assert dense(voxelize(segment, h), -6, 6).max() < 1.08


@pytest.mark.parametrize("voxels_per_diameter", [0.4, 0.6, 1.0, 2.5])
def test_length_is_kept(fibers, voxels_per_diameter):
    size = 2 * 0.01 / voxels_per_diameter
    volume = run(VoxelizeConfig(voxel_size_mm=size, region_mm=((-1, -1, -1), (1, 1, 1))), fibers)
    assert abs(volume.report.relative_difference) < 1e-5
    rng = np.random.default_rng(0)
    start = rng.uniform(-0.5, 0.5, (200, 3))
    segments = np.stack([start, start + rng.normal(size=(200, 3)) * 0.1], axis=1).astype(np.float32)
    expected = np.linalg.norm(segments[:, 1].astype(np.float64) - segments[:, 0], axis=1).sum()
    assert voxelize(segments, size).fiber_length_mm == pytest.approx(expected, rel=1e-5)


def test_line_and_cylinder_meet_smoothly():
    """Growing the voxel through the hand-over changes the largest density without a jump."""
    sizes = np.linspace(1.8, 4.2, 49) * RADIUS
    rng = np.random.default_rng(1)
    middle = rng.uniform(-0.2, 0.2, (40, 3))
    axis = rng.normal(size=(40, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    segments = np.stack([middle - 0.1 * axis, middle + 0.1 * axis], axis=1)
    # the mean over the fibers of the density where a fiber is
    grids = [voxelize(segments, size) for size in sizes]
    means = np.array([(g.density.astype(np.float64) ** 2).sum() / g.density.sum() for g in grids])
    assert np.abs(np.diff(np.log(means))).max() < 0.08
    assert spread(4 * RADIUS, RADIUS) == 0
    assert spread(2 * RADIUS, RADIUS) == 1


def test_lines_keep_the_moments_of_the_disc():
    for size in (0.004, 0.01, 0.02):
        points = line_offsets(size, RADIUS).astype(np.float64)
        assert np.abs(points.mean(axis=0)).max() < 1e-8
        covariance = points.T @ points / len(points)
        # a disc has a^2 / 4 on each axis; the center line gives up its own 1 / (3 K^2) of it
        assert np.abs(covariance / RADIUS**2 - np.eye(2) / 4).max() < 0.005


def test_bits_do_not_depend_on_tiles_or_workers(fibers):
    config = VoxelizeConfig(voxel_size_mm=0.015, region_mm=((-1, -1, -1), (1, 1, 1)))
    hashes = {
        run(config.model_copy(update={"tile_voxels": tile}), fibers, worker_count=workers).content_sha256
        for tile, workers in [(128, 1), (16, 2), (56, 3)]
    }
    assert len(hashes) == 1
