"""Checked storage buffers: moderngl returns a buffer object even where the device had no memory for it."""

from __future__ import annotations

import moderngl
import numpy as np

from weft.files.errors import DeviceMemoryError

MIB = 1024 * 1024
STORAGE_BLOCK_BYTES = 128 * MIB
"""Smallest GL_MAX_SHADER_STORAGE_BLOCK_SIZE that OpenGL 4.3 guarantees, and what Mesa's llvmpipe offers."""


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
    """An uninitialized buffer. Raises `DeviceMemoryError` where the device refuses it."""
    _drain_errors(context)
    try:
        buffer = context.buffer(reserve=byte_count)
    except Exception as error:  # moderngl.Error and MemoryError alike
        raise _memory_error(byte_count, name, str(error)) from error
    if (error_name := context.error) != "GL_NO_ERROR":
        buffer.release()
        raise _memory_error(byte_count, name, error_name)
    return buffer


def read(buffer: moderngl.Buffer, dtype: type | np.dtype | str) -> np.ndarray:
    """The buffer's content as a flat array of its own memory."""
    return np.frombuffer(buffer.read(), dtype=dtype).copy()


def _drain_errors(context: moderngl.Context) -> None:
    while context.error != "GL_NO_ERROR":
        pass


def _memory_error(byte_count: int, name: str, reason: str) -> DeviceMemoryError:
    return DeviceMemoryError(
        f"render: the device has no {byte_count / MIB:.0f} MiB for {name} ({reason}).",
        hint="Raise voxelize.voxel_size_mm or render fewer pixels at once.",
    )
