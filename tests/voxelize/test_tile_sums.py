"""Warp's kernels and their C++ twin: the same bits, whatever is added."""

from __future__ import annotations

import numpy as np
import pytest

from weft.voxelize.accumulator import BrickBatch, TileAccumulator
from weft.voxelize.coverage import line_offsets
from weft.voxelize.native_tiles import active_values, has_native_tiles
from weft.voxelize.sources import FiberSource, SegmentSource, Source
from weft.voxelize.tiles import TileWork, VoxelBox, snap_region

pytestmark = pytest.mark.skipif(not has_native_tiles(), reason="weft was installed without a C++ compiler")
RADIUS = 0.01


def add_all(
    source: Source, voxel: float, *, native: bool, origin=(-32, -32, -32), lines=None, region=None
) -> tuple[BrickBatch, int]:
    region = region or snap_region(None, voxel)
    items = np.arange(len(source.cost))
    work = TileWork(np.array(origin), items, items % 3 > 0)
    accumulator = TileAccumulator(64, voxel, second_moment=True, native=native)
    tile = accumulator.open(work.origin, region, np.zeros((1, 2), np.float32) if lines is None else lines)
    length = source.accumulate(tile, work)
    made = accumulator.resolve(work.origin, RADIUS)
    assert not len(accumulator.resolve(work.origin, RADIUS).origins), "the sums are not clear"
    return made, length


def assert_same_bits(source: Source, voxel: float, **options) -> BrickBatch:
    (ours, length), (twin, twin_length) = (
        add_all(source, voxel, native=native, **options) for native in (True, False)
    )
    assert length == twin_length
    assert np.array_equal(ours.origins, twin.origins)
    for name, values in twin.channels.items():
        assert np.array_equal(ours.channels[name].view(np.uint32), values.view(np.uint32)), name
    return ours


def segments(count: int, size: float, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    start = rng.uniform(-2, 2, (count, 1, 3))
    return np.concatenate([start, start + rng.normal(size=(count, 1, 3)) * size], axis=1).astype(np.float32)


@pytest.mark.parametrize("size", [0.003, 0.1, 3.0])
def test_random_segments(size):
    made = assert_same_bits(SegmentSource(segments(20_000, size), fiber_radius_mm=RADIUS), 0.05)
    assert (made.density > 0).sum() > 10_000


@pytest.mark.parametrize("voxel", [0.035, 0.02, 0.005])
def test_lines_over_the_cross_section(voxel):
    source = SegmentSource(segments(150, 0.1) * 0.1, fiber_radius_mm=RADIUS)
    lines = line_offsets(voxel, RADIUS)
    assert len(lines) > 6
    assert_same_bits(source, voxel, lines=lines)
    assert_same_bits(
        source, voxel, lines=lines, region=VoxelBox(np.array([-3, -9, -2]), np.array([4, 5, 20]))
    )


def test_region_and_tile_cut_segments():
    source = SegmentSource(segments(5000, 1.0), fiber_radius_mm=RADIUS)
    box = VoxelBox(np.array([-20, -11, -25]), np.array([13, 30, 7]))
    made = assert_same_bits(source, 0.05, region=box, origin=(-24, -32, -32))
    assert len(made.origins)


def test_axes_faces_corners_and_no_length():
    steps = np.array([[1, 0, 0], [0, -1, 0], [0, 0, 1], [1, 1, 0], [-1, 1, 1], [0, 0, 0], [1e-30, 1, 0]])
    starts = np.array([[0, 0, 0], [0.05, 0, 0.05], [-0.05, 0.02, 0.1], [1e-38, -1e-38, 0]])
    pairs = np.stack(np.broadcast_arrays(starts[:, None], starts[:, None] + steps * 0.35), axis=2)
    assert_same_bits(SegmentSource(pairs.reshape(-1, 2, 3), fiber_radius_mm=RADIUS), 0.05)


def test_equal_eigenvalues():
    """Two or three axes crossing evenly in each voxel."""
    planes = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, -1, 0], [1, 0, 1], [-1, 0, 1]]) * 0.01
    cells = np.stack(np.meshgrid(*[np.arange(-1, 1, 0.05)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)[::7]
    pairs = [
        np.stack([c + 0.025 - planes[chosen], c + 0.025 + planes[chosen]], axis=1)
        for c, chosen in zip(cells, np.array([[0, 1], [1, 2], [3, 4], [5, 6], [0, 2]] * 4000), strict=False)
    ]
    assert_same_bits(SegmentSource(np.concatenate(pairs), fiber_radius_mm=RADIUS), 0.05)


def test_voxels_that_overflow_32_bits():
    """Hundreds of voxel lengths in one voxel: sums of 32 bits hold 32."""
    pairs = np.repeat(segments(300, 0.4, seed=1), 400, axis=0)
    made = assert_same_bits(SegmentSource(pairs, fiber_radius_mm=RADIUS), 0.2)
    per_voxel = made.density.max() * 0.2**2 / (np.pi * RADIUS**2)
    assert per_voxel > 300


def test_far_from_the_origin():
    far = segments(5000, 0.05) + np.float32(2**21 * 0.05 - 8)
    assert_same_bits(SegmentSource(far, fiber_radius_mm=RADIUS), 0.05, origin=(2**21 - 192,) * 3)


def test_fibers(fibers):
    made = assert_same_bits(FiberSource(fibers), 0.04)
    assert (made.density > 0).sum() > 1000


def test_active_values_one_after_the_other(make_grid):
    grid = make_grid(3, 20)
    for values in (grid.density, grid.direction):
        assert np.array_equal(active_values(values, grid.masks), values[grid.density > 0])
    nothing = make_grid(3, 0)
    assert active_values(nothing.direction, nothing.masks).shape == (0, 3)


def test_order_of_segments_leaves_no_trace():
    pairs = segments(20_000, 0.1)
    shuffled = np.random.default_rng(5).permutation(pairs)
    a, _ = add_all(SegmentSource(pairs, fiber_radius_mm=RADIUS), 0.05, native=True)
    b, _ = add_all(SegmentSource(shuffled, fiber_radius_mm=RADIUS), 0.05, native=True)
    assert np.array_equal(a.density, b.density)
    assert np.array_equal(a.direction, b.direction)
