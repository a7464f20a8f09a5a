"""Checked storage buffers: moderngl returns a buffer object even where the device had no memory for it."""

from __future__ import annotations

import moderngl
import numpy as np

from weft.files.errors import DeviceMemoryError

from .device_memory import UNKNOWN, free_bytes, largest_block_bytes

MIB = 1024 * 1024


class BufferRefused(DeviceMemoryError):
    """The device cannot hold a buffer: which one, how large it would be, and what there is."""

    def __init__(self, name: str, needed: int, available: int, reason: str) -> None:
        self.name, self.needed, self.available = name, needed, available
        offered = "an unknown number" if available == UNKNOWN else str(available)
        super().__init__(
            f"render: {name} need {needed} bytes of the device, and {offered} are available ({reason}).",
            hint="Set a smaller render.brick_pool_mb, raise voxelize.voxel_size_mm or render fewer pixels.",
        )


def upload(context: moderngl.Context, data: np.ndarray, *, name: str) -> moderngl.Buffer:
    """A buffer holding `data`; an empty array becomes 16 zero bytes, since OpenGL refuses empty buffers."""
    contiguous = np.ascontiguousarray(data)
    buffer = reserve(context, max(contiguous.nbytes, 16), name=name)
    if contiguous.nbytes:
        buffer.write(contiguous.reshape(-1).view(np.uint8))
    else:
        buffer.clear()
    return buffer


def reserve(context: moderngl.Context, byte_count: int, *, name: str) -> moderngl.Buffer:
    """An uninitialized buffer. Raises `BufferRefused` where the device has no room for it, or says so."""
    refuse_what_has_no_room(context, byte_count, name=name)
    if byte_count > (largest := largest_block_bytes(context)):
        raise BufferRefused(name, byte_count, largest, "in one storage block of this driver")
    _drain_errors(context)
    try:
        buffer = context.buffer(reserve=byte_count)
    except Exception as error:  # moderngl.Error and MemoryError alike
        raise BufferRefused(name, byte_count, free_bytes(context), str(error)) from error
    if (error_name := context.error) != "GL_NO_ERROR":
        buffer.release()
        raise BufferRefused(name, byte_count, free_bytes(context), error_name)
    return buffer


def refuse_what_has_no_room(context: moderngl.Context, byte_count: int, *, name: str) -> None:
    """Raises `BufferRefused` for more than the driver says there is; most would rather swap than refuse."""
    if byte_count > (available := free_bytes(context)):
        raise BufferRefused(name, byte_count, available, "as the driver says")


def read(
    buffer: moderngl.Buffer, dtype: type | np.dtype | str, *, byte_count: int | None = None
) -> np.ndarray:
    """The buffer's content, or its first bytes, as a flat array of its own memory."""
    data = buffer.read() if byte_count is None else buffer.read(size=byte_count)
    return np.frombuffer(data, dtype=dtype).copy()


def _drain_errors(context: moderngl.Context) -> None:
    while context.error != "GL_NO_ERROR":
        pass
