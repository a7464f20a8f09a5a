"""Too little memory on a device or a machine: the same picture in smaller steps, or exit code 4 and bytes."""

from __future__ import annotations

import re

import pytest

from weft.files import machine_memory
from weft.pipeline.cli import exit_code
from weft.pipeline.picture_volume import _kept_volume
from weft.renderer.gpu import buffers
from weft.renderer.kernel import VOXELS

from .test_interruptions import SETTINGS, assert_same, fresh, rendered  # noqa: F401

pytestmark = pytest.mark.gl


def no_buffer_above(byte_count, monkeypatch):
    monkeypatch.setattr(buffers, "free_bytes", lambda context: byte_count)


def no_room_for_the_voxels(context, byte_count, *, name):
    if name == VOXELS:
        raise buffers.BufferRefused(name, byte_count, 200_000, "a test")


def test_voxels_that_have_no_room_come_through_a_pool(fresh, monkeypatch, capsys):  # noqa: F811
    path, picture, out = fresh
    monkeypatch.setattr(buffers, "refuse_what_has_no_room", no_room_for_the_voxels)
    assert exit_code(["render", str(path), *SETTINGS]) == 0
    assert re.search(r"for want of memory .* MiB of voxels through a pool of", capsys.readouterr().err)
    assert_same(out / "image.exr", picture)


def test_a_device_without_room_ends_with_4_and_both_numbers(fresh, monkeypatch, capsys):  # noqa: F811
    path, _, out = fresh
    no_buffer_above(1000, monkeypatch)
    assert exit_code(["render", str(path), *SETTINGS]) == 4
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("render: the")]
    needed, available = map(int, re.search(r"need (\d+) bytes of the device, and (\d+) are", line).groups())
    assert needed > available == 1000
    assert not list(out.glob("image*"))


def test_a_volume_larger_than_memory_is_read_from_the_disk(fresh, monkeypatch):  # noqa: F811
    path, picture, out = fresh
    size = (out / "volume.vdb").stat().st_size
    monkeypatch.setattr(machine_memory, "available_memory_bytes", lambda: 2 * size)
    _kept_volume.cache_clear()
    assert exit_code(["render", str(path), *SETTINGS]) == 0
    assert (out / "volume.bricks").is_file()
    assert_same(out / "image.exr", picture)
