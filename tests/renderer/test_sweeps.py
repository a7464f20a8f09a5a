"""Whatever paths want is loaded, in windows that fit the pool; samples are added in order."""

from __future__ import annotations

import numpy as np
import pytest

from weft.renderer.batches import Footprints, RenderBatch, rim_of, screen_strips
from weft.renderer.residency import Residency
from weft.renderer.sample_fold import Records, SampleFold
from weft.renderer.sweeps import WINDOW_SHARE, Sweeps, swath_count

COLUMNS, ROWS = range(10, 90), range(5, 65)


def scattered_cells(count, seed):
    """Footprints, some of them outside of the screen, and bricks per cell."""
    rng = np.random.default_rng(seed)
    low = rng.integers(-20, 110, (count, 2)).astype(np.int32)
    depth = rng.random(count).astype(np.float32)
    return Footprints(low, low + rng.integers(0, 5, (count, 2), np.int32), depth), rng.integers(1, 4, count)


@pytest.mark.parametrize("capacity", [3, 40, 5000])
def test_a_sweep_comes_by_every_wanted_cell(capacity):
    """Cells that are wanted again and again, all in one sweep each time; windows fit the pool."""
    footprints, layers = scattered_cells(400, 3)
    sweeps = Sweeps(COLUMNS, ROWS, footprints, layers, capacity, 3)
    for number in range(4):
        wanted = np.arange(400)
        while len(wanted):
            cells = sweeps.next_cells(wanted)
            assert sweeps.number <= number  # the last window of a sweep is still open for the next
            assert len(cells) == len(np.unique(cells)) >= 1
            assert len(cells) == 1 or layers[cells[:-1]].sum() <= capacity * WINDOW_SHARE
            assert np.isin(cells, wanted).all()
            wanted = np.setdiff1d(wanted, cells)


@pytest.mark.parametrize("capacity", [20, 60, 150])
def test_a_sweep_loads_no_brick_twice(capacity):
    """Whatever of a volume larger than the pool is wanted next."""
    footprints, layers = scattered_cells(400, 9)
    sweeps = Sweeps(COLUMNS, ROWS, footprints, layers, capacity, 2)
    residency, rng = Residency(np.cumsum(layers) - layers, layers, capacity), np.random.default_rng(10)
    loaded, number = np.zeros(400, int), 0
    for _ in range(300):
        away = np.flatnonzero(~residency.resident())
        cells = sweeps.next_cells(np.sort(rng.choice(away, rng.integers(1, 30), replace=False)))
        if sweeps.number != number:
            loaded[:], number = 0, sweeps.number
        residency.admit(cells)
        loaded[cells] += 1
        assert loaded.max() == 1
        assert residency.resident()[cells].all()
    assert number > 3


def test_the_rim_of_a_strip_lies_around_it_and_in_the_swath_before():
    footprints, _ = scattered_cells(4000, 11)
    inside = (footprints.low >= (40, 30)) & (footprints.high < (72, 40))
    strip = RenderBatch(range(40, 72), range(30, 40), np.flatnonzero(inside.all(axis=1)))
    wanted = np.arange(0, 4000, 3)
    rim = rim_of(strip, wanted, footprints)
    near = (footprints.low < (72, 44)) & (footprints.high >= (34, 26))
    expected = np.setdiff1d(np.flatnonzero(near.all(axis=1)), strip.cells)
    np.testing.assert_array_equal(rim, np.intersect1d(expected, wanted))
    assert len(rim) > 10


def test_neighbors_in_the_order_of_a_sweep_are_neighbors_on_the_screen():
    footprints, layers = scattered_cells(4000, 4)
    inside = (footprints.low >= (10, 5)).all(axis=1) & (footprints.high < (90, 65)).all(axis=1)
    sweeps = Sweeps(COLUMNS, ROWS, footprints, layers, 30, 2)
    middle = (footprints.low + footprints.high) / 2
    wanted, seen = np.flatnonzero(inside), []
    while len(wanted):
        cells = sweeps.next_cells(wanted)
        seen.append(middle[cells])
        wanted = np.setdiff1d(wanted, cells)
    steps = np.linalg.norm(np.diff(np.concatenate(seen), axis=0), axis=1)
    assert steps.mean() < 0.5 * np.linalg.norm(np.diff(middle[inside], axis=0), axis=1).mean()


@pytest.mark.parametrize(("capacity", "swaths"), [(4, 1), (40, 2), (4000, 7)])
def test_strips_tile_the_screen(capacity, swaths):
    footprints, layers = scattered_cells(400, 5)
    covered = np.zeros((100, 100), int)
    for strip in screen_strips(COLUMNS, ROWS, footprints, layers, capacity, swaths):
        covered[strip.rows.start : strip.rows.stop, strip.columns.start : strip.columns.stop] += 1
    assert (covered[5:65, 10:90] == 1).all()
    assert covered.sum() == 60 * 80


def test_swaths_are_fewer_with_a_larger_pool_and_never_thinner_than_a_pixel():
    counts = [
        swath_count(COLUMNS, ROWS, 10_000, capacity) for capacity in (1, 10, 100, 1000, 10_000, 100_000)
    ]
    assert counts == sorted(counts, reverse=True)
    assert counts[0] <= len(COLUMNS)
    assert counts[-1] == 1


@pytest.mark.parametrize(("samples", "block"), [(range(11), 4), (range(5, 23), 8), (range(3), 16)])
def test_samples_are_summed_as_if_they_had_come_in_order(samples, block):
    rng = np.random.default_rng(8)
    pixels, layers = 30, 2
    values = rng.lognormal(0, 4, (len(samples), pixels, layers * 4)).astype(np.float32)
    blocks = range(samples.start // block, -(-samples.stop // block))
    before = rng.random((len(blocks), layers, pixels, 4)).astype(np.float32)
    wished = before.transpose(0, 2, 1, 3).reshape(len(blocks), pixels, -1).copy()
    for number, sample in enumerate(samples):
        wished[sample // block - blocks.start] += values[number]
    fold = SampleFold(before, samples, block)
    order = rng.permutation(len(samples) * pixels)
    for part in np.array_split(order, 9):
        number, places = np.divmod(part, pixels)
        assert not fold.finished().all()
        fold.add(Records(places, number + samples.start, values[number, places]))
    fold.flush()
    assert fold.finished().all()
    assert not fold.loose
    np.testing.assert_array_equal(
        fold.sums(), wished.reshape(len(blocks), pixels, layers, 4).transpose(0, 2, 1, 3)
    )
