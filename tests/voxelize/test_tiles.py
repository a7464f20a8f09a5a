from __future__ import annotations

import numpy as np
import pytest

from weft.voxelize.tiles import EVERYWHERE, cells_touched, snap_region, tile_work


@pytest.fixture
def boxes() -> np.ndarray:
    rng = np.random.default_rng(0)
    low = rng.uniform(-20, 20, (50, 3))
    return np.stack([low, low + rng.uniform(0, 9, (50, 3))], axis=1).astype(np.float32)


def test_cells_touched_equals_brute_force():
    rng = np.random.default_rng(1)
    low = rng.integers(-20, 20, (30, 3))
    high = low + rng.integers(1, 20, (30, 3))
    box, cells = cells_touched(low, high, 8)
    found = {(int(b), *map(int, cell)) for b, cell in zip(box, cells, strict=True)}
    assert len(found) == len(box)
    lattice = np.stack(np.meshgrid(*[np.arange(-5, 7)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    expected = {
        (b, *map(int, cell))
        for b in range(len(low))
        for cell in lattice
        if ((cell * 8 < high[b]) & (cell * 8 + 8 > low[b])).all()
    }
    assert found == expected


@pytest.mark.parametrize("region_mm", [None, ((-5.0, -5.0, -5.0), (10.0, 3.0, 4.0))])
def test_every_overlap_is_visited_and_first_visited_once(boxes, region_mm):
    size, tile = 0.5, 16
    region = snap_region(region_mm, size)
    works = list(tile_work(boxes, voxel_size_mm=size, region=region, tile=tile))
    corners = [tuple(work.origin) for work in works]
    assert corners == sorted(set(corners))
    first_visits = np.concatenate([work.items[work.first_visit] for work in works])
    assert len(set(first_visits)) == len(first_visits)
    for work in works:
        low = np.maximum(work.origin, region.low) * size
        high = np.minimum(work.origin + tile, region.high) * size
        inside = np.flatnonzero(((boxes[:, 0] < high) & (boxes[:, 1] > low)).all(axis=1))
        assert set(inside) <= set(work.items)
    visited = set(first_visits)
    limits = np.clip([region.low * size, region.high * size], -1e9, 1e9)
    reaching = np.flatnonzero(((boxes[:, 0] < limits[1]) & (boxes[:, 1] > limits[0])).all(axis=1))
    assert set(reaching) <= visited


def test_regions_widen_to_whole_voxels():
    region = snap_region(((0.05, -0.05, 0.1), (0.29, 0.1, 0.31)), 0.1)
    assert region.low.tolist() == [0, -1, 1]
    assert region.high.tolist() == [3, 1, 4]


def test_no_region_is_everywhere():
    assert snap_region(None, 0.1).high.tolist() == [EVERYWHERE] * 3


def test_no_boxes_no_tiles():
    assert not list(tile_work(np.zeros((0, 2, 3)), voxel_size_mm=1.0, region=snap_region(None, 1.0), tile=8))
