"""Shares joined in any order make the bits of one run; what does not belong together is refused by name."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from weft.files.errors import InputError, MergeError
from weft.renderer.checkpoint import SEAL_BYTES, read_checkpoint, write_checkpoint
from weft.renderer.config import ConstantLight, LanczosFilter, RenderConfig
from weft.renderer.exposure import Keeping, Share
from weft.renderer.image import read_exr
from weft.renderer.merge import merge_shares
from weft.renderer.render import run, save
from weft.renderer.scene import IsotropicPhase

from .volumes import random_grid, volume

pytestmark = pytest.mark.gl

CONFIG = RenderConfig(
    resolution=(20, 18), samples_per_pixel=61, block_samples=4, seed=3, lights=[ConstantLight()]
)
GRID = volume(random_grid((2, 2, 1), seed=5, peak=0.5, fill=0.6))
BLOCKS = 16
TILES = ((0, 0, 20, 7), (0, 7, 9, 11), (9, 7, 11, 11))


def render(path, blocks=None, windows=None, grid=GRID, **settings):
    config = CONFIG.model_copy(update=settings)
    share = Share(blocks, windows)
    return run(config, grid, {"a": IsotropicPhase((0.9, 0.8, 0.7))}, keeping=Keeping(path), share=share)


def ranges(count, rng):
    """`BLOCKS` blocks cut into so many ranges."""
    cuts = np.sort(rng.choice(np.arange(1, BLOCKS), count - 1, replace=False))
    return [range(a, b) for a, b in zip([0, *cuts], [*cuts, BLOCKS], strict=True)]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    result = render(folder / "share.exr")
    save(result, folder / "whole.exr")
    return read_exr(folder / "whole.exr")


def assert_same_file(path, whole):
    channels, header = read_exr(path)
    assert set(channels) == set(whole[0])
    for name, data in channels.items():
        np.testing.assert_array_equal(data, whole[0][name], err_msg=name)
    for name in ("weft.samplesPerPixel", "weft.complete", "weft.config", "weft.cutPaths", "weft.device"):
        assert header[name] == whole[1][name]


@pytest.mark.parametrize("count", [1, 2, 5, 8])
def test_shares_of_blocks_and_tiles_in_any_order_make_the_bits_of_one_run(tmp_path, whole, count):
    rng = np.random.default_rng(count)
    parts = ranges(count, rng)
    shares = []
    for i, blocks in enumerate(parts):
        for j, windows in enumerate([(TILES[2],), TILES[:2]] if i % 2 else [None]):
            shares.append(tmp_path / f"{rng.integers(1 << 30)}_{i}_{j}.exr")
            render(shares[-1], blocks, windows)
    for _ in range(3):
        rng.shuffle(shares)
        merged = merge_shares(shares)
        assert merged.complete
        merged.save(tmp_path / "out.exr")
        assert_same_file(tmp_path / "out.exr", whole)


@pytest.fixture(scope="module")
def shares(tmp_path_factory):
    """Four shares of two by two parts."""
    folder, paths = tmp_path_factory.mktemp("shares"), []
    for blocks in (range(0, 7), range(7, BLOCKS)):
        for windows in (TILES[:1], TILES[1:]):
            paths.append(folder / f"{len(paths)}.exr")
            render(paths[-1], blocks, windows)
    return paths


def test_a_missing_share_is_a_hole(shares, tmp_path):
    for left_out in shares:
        rest = [share for share in shares if share != left_out]
        with pytest.raises(MergeError, match=r"samples: \d+ to \d+ of .* are in no share"):
            merge_shares(rest)
    merged = merge_shares(shares[:3], partial=True)
    assert not merged.complete
    merged.save(tmp_path / "part.exr")
    channels, header = read_exr(tmp_path / "part.exr")
    assert header["weft.complete"] == 0
    assert set(np.unique(channels["samples"])) == {28, 61}


def test_a_share_given_twice_or_that_overlaps_is_refused(shares, tmp_path):
    for share in shares:
        (tmp_path / "again.exr").write_bytes(share.read_bytes())
        with pytest.raises(MergeError, match="are in another share too"):
            merge_shares([*shares, tmp_path / "again.exr"])
    render(tmp_path / "more.exr", range(5, 9), ((3, 3, 2, 2),))
    with pytest.raises(MergeError, match="are in another share too"):
        merge_shares([*shares, tmp_path / "more.exr"])


@pytest.mark.parametrize(
    ("settings", "name"),
    [
        ({"seed": 4}, "render.seed"),
        ({"max_bounces": 9}, "render.max_bounces"),
        ({"lights": (ConstantLight(radiance=(1, 2, 1)),)}, "lights and surfaces"),
        ({"filter": LanczosFilter()}, "render.filter.kind"),
        ({"block_samples": 8}, "render.block_samples"),
        ({"crop": (0, 0, 20, 7)}, "render.crop"),
        ({"resolution": (20, 19)}, "render.resolution"),
        ({"grid": volume(random_grid((2, 2, 1), seed=6))}, "volume"),
    ],
    ids=str,
)
def test_shares_of_another_picture_are_refused_by_the_field_that_differs(shares, tmp_path, settings, name):
    render(tmp_path / "other.exr", range(0, 7), TILES[:1], **settings)
    for paths in ([tmp_path / "other.exr", *shares[1:]], [*shares[1:], tmp_path / "other.exr"]):
        with pytest.raises(MergeError, match=f"{name}: ") as caught:
            merge_shares(paths)
        assert caught.value.exit_code == 3


def test_the_device_counts_too(shares, tmp_path):
    one = read_checkpoint(shares[0])
    other = dataclasses.replace(one, identity={**one.identity, "device": "another"})
    write_checkpoint(tmp_path / "other.exr", other)
    with pytest.raises(MergeError, match=r'device: "another" here, .* in '):
        merge_shares([*shares[1:], tmp_path / "other.exr"])


def test_five_hundred_mutants_are_refused(shares, tmp_path):
    """Truncated, a bit changed, bytes changed, swapped, or of another length."""
    rng, path = np.random.default_rng(9), tmp_path / "mutant.exr"
    content = shares[3].read_bytes()
    size = len(content)
    for _ in range(500):
        mutant, place = bytearray(content), int(rng.integers(size))
        kind = rng.integers(4)
        if kind == 0:
            mutant = mutant[:place]
        elif kind == 1:
            mutant[place] ^= 1 << int(rng.integers(8))
        elif kind == 2:
            mutant[place : place + 1] = rng.bytes(3)
        else:
            mutant[place : place + 9] = bytes(255 - b for b in mutant[place : place + 9])
        path.write_bytes(mutant)
        with pytest.raises(MergeError, match="mutant"):
            merge_shares([*shares[:3], path])
    assert size > SEAL_BYTES


def test_a_stopped_share_is_a_hole_until_it_is_finished(tmp_path, shares):
    with pytest.raises(InputError, match="no such file"):
        merge_shares([tmp_path / "none.exr"])
    one = read_checkpoint(shares[0])
    write_checkpoint(tmp_path / "stopped.exr", dataclasses.replace(one, units=one.units[:-1]))
    with pytest.raises(MergeError, match="are in no share"):
        merge_shares([tmp_path / "stopped.exr", *shares[1:]])
