"""Length is conserved, and the bits do not depend on how the work was split."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from weft.files.errors import InputError
from weft.voxelize.config import VoxelizeConfig
from weft.voxelize.voxelize import run, voxelize_segments


@pytest.fixture(scope="module")
def segments() -> np.ndarray:
    """Wandering fibers across several tiles, far from the origin on one axis."""
    rng = np.random.default_rng(0)
    steps = rng.normal(size=(300, 60, 3)) * 0.05 + rng.normal(size=(300, 1, 3)) * 0.02
    points = rng.uniform(-1, 1, (300, 1, 3)) + np.cumsum(steps, axis=1) + [200.0, 0.0, 0.0]
    return np.stack([points[:, :-1], points[:, 1:]], axis=2).reshape(-1, 2, 3).astype(np.float32)


def total_length(segments: np.ndarray) -> float:
    delta = segments[:, 1].astype(np.float64) - segments[:, 0]
    return float(np.linalg.norm(delta, axis=1).sum())


@pytest.mark.parametrize("voxel_size_mm", [0.04, 0.11, 0.5, 4.0])
@pytest.mark.parametrize("tile_voxels", [16, 128])
def test_segments_conserve_length(segments, voxel_size_mm, tile_voxels):
    config = VoxelizeConfig(voxel_size_mm=voxel_size_mm, tile_voxels=tile_voxels)
    volume = voxelize_segments(config, segments, fiber_radius_mm=0.01)
    assert volume.fiber_length_mm == pytest.approx(total_length(segments), rel=1e-5)
    assert volume.report.generated_length_mm == pytest.approx(total_length(segments), rel=1e-7)
    assert abs(volume.report.relative_difference) < 1e-5
    volume.grids["fiber"].check_values()


@pytest.mark.parametrize("voxel_size_mm", [0.04, 0.15, 1.0])
def test_fibers_conserve_length_per_medium(fibers, voxel_size_mm):
    volume = run(VoxelizeConfig(voxel_size_mm=voxel_size_mm), fibers)
    lengths = fibers.fiber_lengths_mm().sum(axis=1)
    for medium, (name, grid) in enumerate(volume.grids.items()):
        expected = lengths[fibers.stretch_type() == medium].sum()
        assert grid.fiber_length_mm == pytest.approx(expected, rel=1e-5), name
        grid.check_values()
    assert volume.report.generated_length_mm == pytest.approx(lengths.sum(), rel=1e-7)


def test_bits_do_not_depend_on_tiles_or_workers(fibers):
    hashes, lengths = set(), set()
    for tile, workers in [(128, 1), (128, 2), (16, 1), (24, 3), (72, 2)]:
        config = VoxelizeConfig(voxel_size_mm=0.06, tile_voxels=tile)
        volume = run(config, fibers, worker_count=workers)
        hashes.add(volume.content_sha256)
        lengths.add(volume.report.generated_length_mm)
    assert len(hashes) == 1
    assert len(lengths) == 1


def test_bits_do_not_depend_on_the_order_of_segments(segments):
    config = VoxelizeConfig(voxel_size_mm=0.1)
    shuffled = np.random.default_rng(1).permutation(segments)
    volumes = [voxelize_segments(config, s, fiber_radius_mm=0.01) for s in (segments, shuffled)]
    assert volumes[0].content_sha256 == volumes[1].content_sha256


def test_fibers_equal_their_explicit_segments(fibers):
    from weft.fiber_model.fiber_curves import FiberSelection, export_curves

    one_type = {"yarn_type": np.zeros(2, np.int32), "type_names": ("yarn",), "fiber_radius_mm": (0.01,)}
    one_medium = dataclasses.replace(fibers, **one_type)
    curves = export_curves(one_medium, FiberSelection())
    pairs = np.stack([curves.points[:-1], curves.points[1:]], axis=1)
    inside = np.ones(len(pairs), dtype=bool)
    inside[curves.offsets[1:-1] - 1] = False
    config = VoxelizeConfig(voxel_size_mm=0.1)
    explicit = voxelize_segments(config, pairs[inside], fiber_radius_mm=0.01).grids["fiber"]
    generated = run(config, one_medium).grids["yarn"]
    assert explicit.fiber_length_mm == pytest.approx(generated.fiber_length_mm, rel=1e-7)
    assert np.array_equal(explicit.origins, generated.origins)
    assert np.abs(explicit.density - generated.density).max() < 1e-4 * generated.density.max()


def test_a_region_holds_the_same_voxels(fibers):
    size = 0.1
    whole = run(VoxelizeConfig(voxel_size_mm=size), fibers)
    low, high = np.array([-9, -7, -3]), np.array([13, 21, 30])
    region = (tuple(low * size), tuple(high * size))
    part = run(VoxelizeConfig(voxel_size_mm=size, region_mm=region, tile_voxels=16), fibers)
    for name, grid in whole.grids.items():
        expected = {}
        local = np.stack(np.unravel_index(np.arange(512), (8, 8, 8)), axis=1)
        for origin, density in zip(grid.origins, grid.density, strict=True):
            place = origin + local
            kept = np.where(((place >= low) & (place < high)).all(axis=1), density, np.float32(0))
            if kept.any():
                expected[tuple(origin)] = kept
        found = dict(zip(map(tuple, part.grids[name].origins), part.grids[name].density, strict=True))
        assert found.keys() == expected.keys()
        assert all(np.array_equal(found[key], expected[key]) for key in found)
    assert abs(part.report.relative_difference) < 1e-5


def test_progress_rises_to_one(fibers):
    seen = []
    run(
        VoxelizeConfig(voxel_size_mm=0.1, tile_voxels=32),
        fibers,
        progress=lambda fraction, detail: seen.append(fraction),
    )
    assert seen == sorted(seen)
    assert seen[-1] == 1.0


def test_report_counts(fibers):
    volume = run(VoxelizeConfig(voxel_size_mm=0.02), fibers)
    report = volume.report
    assert report.voxel_count == volume.voxel_count
    assert report.brick_count == volume.brick_count
    assert report.item_count == fibers.stretch_count
    assert report.max_volume_fraction == max(float(grid.density.max()) for grid in volume.grids.values())
    assert report.overfull_voxel_count == sum(int((g.density > 1).sum()) for g in volume.grids.values()) > 0


@pytest.mark.parametrize(
    ("config", "message"),
    [
        (
            {"voxel_size_mm": 0.1, "region_mm": ((50, 50, 50), (51, 51, 51))},
            "voxelize.region_mm: no fiber lies in it",
        ),
        ({"voxel_size_mm": 1e-4, "region_mm": ((0, 0, 0), (0.01, 0.01, 0.01)), "memory_mb": 1}, "may need"),
        ({"voxel_size_mm": 1e-5}, "may need"),
        ({"voxel_size_mm": 1e-6}, "may need|voxels from the origin"),
    ],
)
def test_impossible_requests_are_refused_in_one_line(fibers, config, message):
    with pytest.raises(InputError, match=message) as caught:
        run(VoxelizeConfig(**config), fibers)
    assert caught.value.exit_code == 2
    assert "\n" not in str(caught.value)


def test_fibers_too_far_out_are_refused():
    far = np.array([[[1e6, 0, 0], [1e6, 0, 1]]], np.float32)
    with pytest.raises(InputError, match="voxels from the origin"):
        voxelize_segments(VoxelizeConfig(voxel_size_mm=0.05), far, fiber_radius_mm=0.01)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_positions_that_are_not_finite_are_refused(value):
    segments = np.zeros((3, 2, 3), np.float32)
    segments[1, 1, 2] = value
    with pytest.raises(InputError, match="not finite"):
        voxelize_segments(VoxelizeConfig(voxel_size_mm=0.05), segments, fiber_radius_mm=0.01)


def test_no_segments_are_refused():
    with pytest.raises(InputError, match="no segments"):
        voxelize_segments(VoxelizeConfig(voxel_size_mm=1.0), np.zeros((0, 2, 3)), fiber_radius_mm=0.01)
