"""A run that is stopped and resumed makes the same bits; a checkpoint holds all that takes, or is refused."""

from __future__ import annotations

import itertools
import resource
from contextlib import nullcontext

import numpy as np
import pytest

from weft.files.errors import DiskSpaceError, InputError, MergeError
from weft.renderer import checkpoint as checkpoint_module
from weft.renderer.blocks import TileSums
from weft.renderer.checkpoint import SEAL_BYTES, read_checkpoint, write_checkpoint
from weft.renderer.config import ConstantLight, LanczosFilter, RenderConfig
from weft.renderer.exposure import Keeping
from weft.renderer.kernel import KernelOptions
from weft.renderer.render import run
from weft.renderer.scene import IsotropicPhase

from .volumes import random_grid, volume

pytestmark = pytest.mark.gl

CONFIG = RenderConfig(
    resolution=(20, 18), samples_per_pixel=11, block_samples=4, seed=3, lights=[ConstantLight()]
)
GRID = volume(random_grid((2, 2, 1), seed=5, peak=0.5, fill=0.6))
SHORT = {"lane_count": 64, "rounds_per_dispatch": 1}


class StopAfter:
    """Asks to stop after so many questions."""

    def __init__(self, count):
        self.left = count

    def __call__(self):
        self.left -= 1
        return self.left < 0


def render(path, *, stop=10**9, resume=True, every_s=1e9, options=None, **settings):
    return run(
        CONFIG.model_copy(update=settings),
        GRID,
        {"a": IsotropicPhase((0.9, 0.8, 0.7))},
        options=KernelOptions(**(SHORT | (options or {}))),
        keeping=Keeping(path, every_s=every_s, resume=resume),
        stopping=nullcontext(StopAfter(stop)),
    )


def assert_same(one, other):
    assert set(one.layers) == set(other.layers)
    for name, layer in one.layers.items():
        np.testing.assert_array_equal(layer, other.layers[name], err_msg=name)


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    return render(tmp_path_factory.mktemp("whole") / "a.exr")


@pytest.mark.parametrize("options", [{}, {"blocks_per_pass": 1}, {"rows_per_pass": 5}], ids=str)
def test_stopped_after_any_dispatch_and_resumed_it_makes_the_same_bits(tmp_path, uninterrupted, options):
    path, stops, done = tmp_path / "a.exr", 0, False
    while not done:
        result = render(path, stop=13, options=options)
        stops, done = stops + 1, result.complete
    assert stops > 5
    assert_same(result, uninterrupted)
    for counted in ("paths", "scattering_events", "tracking_steps", "cut_paths"):
        assert getattr(result.statistics, counted) == getattr(uninterrupted.statistics, counted)


def test_paths_under_way_are_done_again_where_the_device_runs_other_lanes(tmp_path, uninterrupted):
    assert not render(tmp_path / "a.exr", stop=40).complete
    result = render(tmp_path / "a.exr", options={"lane_count": 128})
    assert_same(result, uninterrupted)
    assert result.statistics.paths == uninterrupted.statistics.paths


def test_more_samples_continue_a_finished_picture_and_its_last_block(tmp_path):
    """5 samples are a block and a quarter; none is taken twice."""
    first = render(tmp_path / "a.exr", samples_per_pixel=5, every_s=0)
    assert first.complete
    more = render(tmp_path / "a.exr", samples_per_pixel=26)
    assert more.statistics.paths == 20 * 18 * 26
    assert_same(more, render(tmp_path / "b.exr", samples_per_pixel=26))


def test_a_stopped_picture_holds_whole_blocks_of_each_pixel(tmp_path):
    """Every pixel's mean is that of the picture with as many samples."""
    whole = {
        count: render(tmp_path / "whole.exr", resume=False, samples_per_pixel=count)
        for count in (4, 8, 10, 11)
    }
    render(tmp_path / "a.exr", samples_per_pixel=10, every_s=0)
    seen = set()
    for stop in range(5, 125, 15):
        result = render(tmp_path / "a.exr", stop=stop, samples_per_pixel=11, options={"blocks_per_pass": 1})
        fewer = render(tmp_path / f"{stop}.exr", stop=stop, options={"blocks_per_pass": 2})
        for picture in (result, fewer):
            counts = picture.layers["samples"]
            for count, full in whole.items():
                here = counts == count
                np.testing.assert_array_equal(picture.radiance[here], full.radiance[here])
            assert np.isin(counts, [0, *whole]).all()
            assert not picture.radiance[counts == 0].any()
            seen |= set(counts.ravel().tolist())
    assert seen >= {0, 4, 8, 10, 11}


def test_a_pool_on_the_device_may_come_and_go(tmp_path, uninterrupted):
    """What is finished counts with any pool; paths under way go on in one of the same size."""
    pools = (0.0079, None, 0.0041, 0.0079)
    for pool in pools:
        assert not render(tmp_path / "a.exr", stop=20, brick_pool_mb=pool).complete
    assert_same(render(tmp_path / "a.exr", brick_pool_mb=pools[0]), uninterrupted)


def test_filtered_pictures_resume_as_well(tmp_path):
    settings = {"filter": LanczosFilter(), "crop": (3, 2, 9, 11)}
    render(tmp_path / "a.exr", stop=20, **settings)
    assert_same(render(tmp_path / "a.exr", **settings), render(tmp_path / "b.exr", **settings))


def test_noise_decides_once(tmp_path):
    settings = {"noise": 0.08, "samples_per_pixel": 4096}
    whole = render(tmp_path / "b.exr", options={"rounds_per_dispatch": None}, **settings)
    assert not render(tmp_path / "a.exr", stop=200, **settings).complete
    resumed = render(tmp_path / "a.exr", **settings)
    assert_same(resumed, whole)
    assert resumed.statistics.paths == whole.statistics.paths


def test_checkpoints_on_the_way_resume_too(tmp_path, uninterrupted, monkeypatch):
    """As after kill -9: whatever was written last is what there is."""
    written = []

    def write(path, state):
        write_checkpoint(path, state)
        written.append(path.read_bytes())

    monkeypatch.setattr("weft.renderer.exposure.write_checkpoint", write)
    render(tmp_path / "a.exr", every_s=0)
    monkeypatch.undo()
    assert len(written) > 50
    for content in written[::25]:
        (tmp_path / "b.exr").write_bytes(content)
        assert_same(render(tmp_path / "b.exr"), uninterrupted)


def test_blocks_are_folded_in_ascending_order():
    """Of 1, 2^60 and -2^60 the order decides the sum in float64."""
    tile = TileSums((0, 0, 1, 1), layer_count=1, block_samples=4)
    blocks = np.float32([1, 2.0**60, -(2.0**60)]).reshape(3, 1, 1, 1) * np.ones((1, 1, 1, 4), np.float32)
    tile.add(range(12), blocks)
    assert not tile.total()[0].any()
    (unit,) = tile.units()
    assert unit.folded
    assert not unit.sums.any()


def test_a_checkpoint_of_another_picture_is_refused_by_name(tmp_path):
    render(tmp_path / "a.exr", stop=20)
    with pytest.raises(MergeError, match=r"a\.exr: render\.seed: 3 here, 4 in this run") as caught:
        render(tmp_path / "a.exr", seed=4)
    assert caught.value.exit_code == 3


def test_short_runs_leave_no_checkpoint_and_none_of_an_earlier_run(tmp_path):
    render(tmp_path / "a.exr", stop=20)
    assert (tmp_path / "a.exr").is_file()
    assert render(tmp_path / "a.exr", resume=False).complete
    assert list(tmp_path.iterdir()) == []


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    path = tmp_path_factory.mktemp("kept") / "a.exr"
    render(path, stop=60, options={"blocks_per_pass": 1})
    return path.read_bytes()


def test_a_checkpoint_reads_back_whole(tmp_path, kept):
    (tmp_path / "a.exr").write_bytes(kept)
    one = read_checkpoint(tmp_path / "a.exr")
    assert one.begun is not None
    assert any(unit.folded for unit in one.units)
    write_checkpoint(tmp_path / "b.exr", one)
    two = read_checkpoint(tmp_path / "b.exr")
    assert (two.identity, two.window, two.notes) == (one.identity, one.window, one.notes)
    np.testing.assert_array_equal(two.units[0].sums, one.units[0].sums)
    np.testing.assert_array_equal(two.begun.lanes, one.begun.lanes)


def test_a_truncated_or_damaged_checkpoint_is_refused(tmp_path, kept):
    rng = np.random.default_rng(1)
    path = tmp_path / "a.exr"
    cuts = [0, 1, SEAL_BYTES - 1, SEAL_BYTES, len(kept) - SEAL_BYTES, len(kept) - 1]
    mutants = [kept[:cut] for cut in [*cuts, *rng.integers(0, len(kept), 50)]]
    places = [*range(len(kept) - SEAL_BYTES, len(kept)), *rng.integers(0, len(kept), 450)]
    mutants += [kept[:i] + bytes([kept[i] ^ (1 << rng.integers(8))]) + kept[i + 1 :] for i in places]
    mutants += [kept + b"\0", b"\0" + kept, kept[::-1]]
    for mutant in mutants:
        path.write_bytes(mutant)
        with pytest.raises(MergeError) as caught:
            read_checkpoint(path)
        assert str(path) in str(caught.value)
    with pytest.raises(InputError, match="no such file"):
        read_checkpoint(tmp_path / "none.exr")


def test_a_full_disk_leaves_the_previous_checkpoint(tmp_path, kept, monkeypatch):
    path = tmp_path / "a.exr"
    path.write_bytes(kept)
    before = read_checkpoint(path)

    def full(*arguments):
        raise OSError(28, "No space left on device")

    for name in ("write_parts", "_seal", "_compare"):
        monkeypatch.setattr(checkpoint_module, name, full)
        with pytest.raises(DiskSpaceError) as caught:
            write_checkpoint(path, before)
        assert caught.value.exit_code == 5
        monkeypatch.undo()
        assert path.read_bytes() == kept
        assert list(tmp_path.iterdir()) == [path]


def test_a_disk_that_fills_up_at_any_byte_leaves_the_previous_checkpoint(tmp_path, kept):
    """A limit on the size of files, so that the writes themselves fail."""
    path = tmp_path / "a.exr"
    path.write_bytes(kept)
    before, soft = read_checkpoint(path), resource.getrlimit(resource.RLIMIT_FSIZE)
    for limit in [0, 1, 7, len(kept) - SEAL_BYTES, len(kept) - 1, *range(100, len(kept), len(kept) // 40)]:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, soft[1]))
        try:
            with pytest.raises(DiskSpaceError):
                write_checkpoint(path, before)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, soft)
        assert path.read_bytes() == kept
        assert list(tmp_path.iterdir()) == [path]
    write_checkpoint(path, before)


def test_out_of_core_it_goes_on_where_it_was(tmp_path, uninterrupted):
    """Stopped in strips and in sweeps, with paths aside, samples that wait for others, other lanes."""
    pool, path, lanes = 0.0045, tmp_path / "a.exr", itertools.cycle((64, 128))
    whole = render(tmp_path / "b.exr", brick_pool_mb=pool)
    assert whole.statistics.brick_uploads > whole.statistics.bricks_used
    result, stops, loose, strips = render(path, stop=3, brick_pool_mb=pool), 0, 0, set()
    while not result.complete:
        aside = read_checkpoint(path).begun.aside
        loose, strips = loose + len(aside.loose), strips | {aside.strip}
        options = {"lane_count": next(lanes), "rounds_per_dispatch": 2}
        result, stops = render(path, stop=7, brick_pool_mb=pool, options=options), stops + 1
    assert stops > 5
    assert loose > 0
    assert len(strips) > 3
    assert_same(result, uninterrupted)
    for counted in ("paths", "scattering_events", "tracking_steps", "cut_paths"):
        assert getattr(result.statistics, counted) == getattr(uninterrupted.statistics, counted)


def test_out_of_core_a_stopped_picture_holds_whole_blocks(tmp_path):
    settings = {"resume": False, "brick_pool_mb": 0.0045}
    whole = {n: render(tmp_path / "w.exr", resume=False, samples_per_pixel=n) for n in (4, 8, 11)}
    seen = set()
    for stop in (10, 40, 80, 120):
        result = render(tmp_path / "a.exr", stop=stop, **settings)
        counts = result.layers["samples"]
        for count, full in whole.items():
            here = counts == count
            np.testing.assert_array_equal(result.radiance[here], full.radiance[here])
        assert np.isin(counts, [0, *whole]).all()
        seen |= set(counts.ravel().tolist())
    assert seen >= {0, 11}
