"""Coarser levels conserve fiber length and second moment; two lobes keep crossed bundles apart."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.voxelize.extinction import extinction_by_voxel, extinction_error, symmetric
from weft.voxelize.config import VoxelizeConfig
from weft.voxelize.grid import FiberGrid, FiberVolume
from weft.voxelize.grid_files import SECOND_LOBE, base_medium
from weft.voxelize.level_of_detail import (
    VIEW_COUNT,
    blocks_of,
    coarsen,
    coarsen_values,
)
from weft.voxelize.level_of_detail import extinction_error as measured_error
from weft.voxelize.voxelize import run, voxelize_segments


def directions(count: int) -> np.ndarray:
    w = np.random.default_rng(0).normal(size=(count, 3))
    return w / np.linalg.norm(w, axis=1, keepdims=True)


@pytest.fixture(scope="module")
def fine(fibers) -> FiberVolume:
    return run(VoxelizeConfig(voxel_size_mm=0.05, second_moment=True), fibers)


def moment_of(volume: FiberVolume, name: str) -> np.ndarray:
    """Sum of length times T, [3, 3], up to a constant."""
    grid = volume.grids[name]
    occupied = grid.density > 0
    t = symmetric(grid.moment_diag[occupied], grid.moment_off[occupied])
    return (grid.density[occupied].astype(np.float64)[:, None, None] * t).sum(axis=0) * grid.voxel_size_mm**3


@pytest.mark.parametrize("lobes", [1, 2])
def test_length_and_second_moment_are_conserved(fine, lobes):
    for factor in (2, 4, 8, 32):
        level = coarsen(fine, lobes=lobes, factor=factor)
        assert level.voxel_size_mm == pytest.approx(factor * fine.voxel_size_mm)
        for name, grid in fine.grids.items():
            parts = [key for key in level.media if key in (name, name + SECOND_LOBE)]
            assert len(parts) == lobes
            length = sum(level.grids[key].fiber_length_mm for key in parts)
            assert length == pytest.approx(grid.fiber_length_mm, rel=1e-5)
            moment, expected = sum(moment_of(level, key) for key in parts), moment_of(fine, name)
            assert np.abs(moment - expected).max() < 1e-5 * np.trace(expected)
        for grid in level.grids.values():
            grid.check_values()
            occupied = grid.density > 0
            assert np.abs(grid.moment_diag[occupied].sum(axis=1) - 1).max() < 1e-5


def crossed(spacing: float, half: float) -> np.ndarray:
    """Warp along x below the plane z = 0, and weft along y above it, in the ratio of 1 to 3."""
    x = np.arange(-half + spacing / 2, half, spacing)
    a, b = (grid.reshape(-1, 1) for grid in np.meshgrid(x, x[x < 0]))
    ones = np.ones_like(a)
    warp = np.stack([np.hstack([-half * ones, a, b]), np.hstack([half * ones, a, b])], axis=1)
    weft = np.stack([np.hstack([a, -half * ones, -b]), np.hstack([a, half * ones, -b])], axis=1)
    return np.concatenate([warp[::3], weft]).astype(np.float32)


def test_two_lobes_keep_crossed_bundles_within_2_percent():
    """One lobe: what the average direction makes of them is reported, and far off."""
    config = VoxelizeConfig(voxel_size_mm=0.2, second_moment=True)
    segments = crossed(0.01, 0.4)
    volume = voxelize_segments(config, segments, fiber_radius_mm=0.003)
    # one coarse voxel on each side of the origin would hold one bundle: shift by half of one
    shifted = segments + np.float32([0, 0, 0.2])
    volume = voxelize_segments(config, shifted, fiber_radius_mm=0.003)
    w = directions(300)
    mixed = {
        cube: value
        for cube, value in extinction_by_voxel(volume, w, voxel=2).items()
        if cube[2] == 0 and -1 <= cube[0] <= 0 and -1 <= cube[1] <= 0
    }
    assert len(mixed) == 4
    two, one = (extinction_by_voxel(coarsen(volume, lobes=lobes), w, voxel=1) for lobes in (2, 1))
    errors = {
        lobes: max(float(np.abs(found[cube] / value - 1).max()) for cube, value in mixed.items())
        for lobes, found in ((2, two), (1, one))
    }
    assert errors[2] < 0.02
    assert errors[1] > 0.25


def test_one_direction_needs_no_second_lobe():
    axis = np.array([1, 2, 3]) / math.sqrt(14)
    middle = np.random.default_rng(0).uniform(-1, 1, (400, 3))
    segments = np.stack([middle - axis, middle + axis], axis=1).astype(np.float32)
    fine = voxelize_segments(VoxelizeConfig(voxel_size_mm=0.1), segments, fiber_radius_mm=0.003)
    assert coarsen(fine).grids["fiber" + SECOND_LOBE].voxel_count == 0


def test_two_lobes_serve_cloth_better_than_one(fine):
    w = directions(40)
    one, two = (extinction_error(fine, coarsen(fine, lobes=lobes), w) for lobes in (1, 2))
    assert two[1] < one[1]
    assert abs(two[0]) < abs(one[0])


@pytest.mark.parametrize("lobes", [1, 2])
@pytest.mark.parametrize("factor", [2, 4])
def test_measured_error_is_that_of_the_volume(fine, lobes, factor):
    """What the kernel adds up, against numpy on the finished volumes, in the same directions."""
    z = (np.arange(VIEW_COUNT) + 0.5) / VIEW_COUNT
    angle, radius = np.arange(VIEW_COUNT) * math.pi * (3 - math.sqrt(5)), np.sqrt(1 - z * z)
    w = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
    grid = fine.grids["warp"]
    found = measured_error(
        sum(
            coarsen_values(
                grid.origins[rows], _values(grid, rows), side=16, factor=factor, lobes=lobes
            ).error_sums
            for rows in blocks_of(grid.origins, 16)
        )
    )
    one = FiberVolume({"warp": grid})
    mean, rms = extinction_error(one, coarsen(one, lobes=lobes, factor=factor), w)
    assert found.mean == pytest.approx(mean, abs=1e-5)
    assert found.rms == pytest.approx(rms, rel=1e-3)


def _values(grid: FiberGrid, rows: np.ndarray) -> dict[str, np.ndarray]:
    return {name: array[rows] for name, array in grid.channels.items()}


def test_the_second_lobe_is_named_after_its_medium():
    media = ("warp", "warp_crossing", "rail_crossing")
    assert [base_medium(name, media) for name in media] == ["warp", "warp", "rail_crossing"]


@pytest.mark.proof
def test_table_of_extinction_errors_by_level(fine, capsys):
    """Prints the table of the README."""
    w = directions(40)
    with capsys.disabled():
        for level in (1, 2, 3, 4):
            one, two = (coarsen(fine, lobes=lobes, factor=2**level) for lobes in (1, 2))
            errors = [extinction_error(fine, made, w) for made in (one, two)]
            cells = " | ".join(f"{mean:+.2%}, {rms:.2%}" for mean, rms in errors)
            print(f"\n| {level} | {one.voxel_size_mm:g} mm | {cells} |", end="")
    assert one.fiber_length_mm == pytest.approx(fine.fiber_length_mm, rel=1e-5)
