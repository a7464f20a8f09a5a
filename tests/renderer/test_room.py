"""A device with too little memory makes the same bits in more steps, or the error names the bytes."""

from __future__ import annotations

import weakref

import moderngl
import numpy as np
import pytest

from weft.files.errors import DeviceMemoryError
from weft.renderer.config import ConstantLight, RenderConfig
from weft.renderer.gpu import buffers
from weft.renderer.gpu.context import shared_context
from weft.renderer.gpu.device_memory import free_bytes, largest_block_bytes
from weft.renderer.kernel import default_lane_count
from weft.renderer.render import run
from weft.renderer.scene import IsotropicPhase

from .volumes import random_grid, volume

pytestmark = pytest.mark.gl

CONFIG = RenderConfig(
    resolution=(40, 30), samples_per_pixel=6, block_samples=2, seed=3, lights=[ConstantLight()]
)
GRID = volume(random_grid((5, 4, 4), seed=5, peak=0.5, fill=0.6))
VOXEL_BYTES = 80 * 2048


class Device:
    """One that counts the bytes of its buffers and has so many."""

    def __init__(self, monkeypatch):
        self.size, self.alive, make = 2**40, [], moderngl.Context.buffer

        def buffer(context, *arguments, **options):
            made = make(context, *arguments, **options)
            self.alive.append(weakref.ref(made))
            self.most = max(self.most, self.used)
            return made

        self.most = 0
        monkeypatch.setattr(moderngl.Context, "buffer", buffer)
        monkeypatch.setattr(buffers, "free_bytes", lambda context: max(self.size - self.used, 0))

    @property
    def used(self):
        held = [reference() for reference in self.alive]
        return sum(b.size for b in held if b is not None and type(b.mglo).__name__ != "InvalidObject")


@pytest.fixture
def device(monkeypatch):
    return Device(monkeypatch)


def picture(**settings):
    config = CONFIG.model_copy(update=settings)
    return run(config, GRID, {"a": IsotropicPhase((0.9, 0.8, 0.7))})


def refusal_or_picture():
    try:
        return picture()
    except DeviceMemoryError as refused:
        return refused


def assert_same(one, other):
    for name, layer in one.layers.items():
        np.testing.assert_array_equal(layer, other.layers[name], err_msg=name)


@pytest.fixture(scope="module")
def whole():
    return picture()


def test_a_smaller_device_makes_the_same_bits_or_names_the_bytes(device, whole):
    """From all that the picture takes down to nothing."""
    assert_same(picture(), whole)
    needed, made = device.most, []
    for share in (1.0, 0.6, 0.3, 0.12, 0.03):
        device.size, device.most = int(share * needed), 0
        smaller = refusal_or_picture()
        if isinstance(smaller, DeviceMemoryError):
            made.append("refused")
            assert smaller.needed > smaller.available >= 0
            assert f"need {smaller.needed} bytes of the device, and {smaller.available} are" in str(smaller)
            assert smaller.exit_code == 4
        else:
            made.append(smaller.statistics.made_smaller)
            assert_same(smaller, whole)
            assert device.most <= device.size
        assert device.used == 0
    assert made[0] == ""
    assert any("voxels through a pool of" in one for one in made)
    assert any("paths at a time" in one for one in made)
    assert made[-1] == "refused"


def test_sums_that_have_no_room_are_taken_in_parts(device, whole, monkeypatch):
    """Pixels and blocks by the room there is, not by what the picture would need."""
    reserve, sizes = buffers.reserve, []

    def at_most_ten_rows(context, byte_count, *, name):
        if name == "the sums of the picture":
            sizes.append(byte_count)
            if byte_count > 40 * 10 * 16 * 6:
                raise buffers.BufferRefused(name, byte_count, 40 * 10 * 16 * 6, "a test")
        return reserve(context, byte_count, name=name)

    monkeypatch.setattr(buffers, "reserve", at_most_ten_rows)
    assert_same(picture(), whole)
    assert len(sizes) > 2


def test_a_driver_that_refuses_is_believed(monkeypatch, whole):
    """GL_OUT_OF_MEMORY, though it said that there is room."""
    make, refused = moderngl.Context.buffer, []

    def buffer(context, *arguments, reserve=0, **options):
        if reserve > VOXEL_BYTES // 3:
            refused.append(reserve)
            raise moderngl.Error("cannot create buffer")
        return make(context, *arguments, reserve=reserve, **options)

    monkeypatch.setattr(moderngl.Context, "buffer", buffer)
    smaller = picture()
    assert refused
    assert "through a pool of" in smaller.statistics.made_smaller
    assert_same(smaller, whole)


def test_a_pool_that_decides_what_is_seen_is_not_made_smaller(device):
    device.size = VOXEL_BYTES // 2
    with pytest.raises(DeviceMemoryError):
        picture(outside_batch="homogeneous", brick_pool_mb=0.9 * VOXEL_BYTES / 2**20)


def test_a_buffer_larger_than_a_block_of_the_driver_is_refused(monkeypatch):
    largest = largest_block_bytes(shared_context())
    monkeypatch.setattr(buffers, "free_bytes", lambda context: 2**50)
    with pytest.raises(DeviceMemoryError, match=f"need {largest + 1} bytes of the device, and {largest} are"):
        buffers.reserve(shared_context(), largest + 1, name="a test")


def test_a_device_says_what_it_has():
    assert free_bytes(shared_context()) > 2**20
    assert default_lane_count(shared_context()) >= 1024
