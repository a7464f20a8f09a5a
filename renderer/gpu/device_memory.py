"""How much memory a device has left, as far as its driver says.

OpenGL itself does not tell, and drivers move what does not fit to the host, or are killed for it, rather than
refuse. NVIDIA's say it through GL_NVX_gpu_memory_info, AMD's (and Mesa's for AMD) through GL_ATI_meminfo; a
software driver has what the machine has.
"""

from __future__ import annotations

import ctypes
from functools import cache

import moderngl

from weft.files.machine_memory import available_memory_bytes

NVX_CURRENT_AVAILABLE_VIDMEM = 0x9049
ATI_VBO_FREE_MEMORY = 0x87FB
"""Four numbers, the first of which is the total that is free. Both in KiB."""
UNKNOWN = 2**62
GUARANTEED_BLOCK_BYTES = 128 * 1024 * 1024
"""Smallest GL_MAX_SHADER_STORAGE_BLOCK_SIZE that OpenGL 4.3 guarantees, and what Mesa's llvmpipe names."""
SOFTWARE_BLOCK_BYTES = 2**31 - 4
"""llvmpipe reads past the size it names; beyond this one, offsets have no room in 31 bits."""


def free_bytes(context: moderngl.Context) -> int:
    """What the device can still give; `UNKNOWN` where its driver does not say."""
    if is_software(context):
        return available_memory_bytes()
    if "GL_NVX_gpu_memory_info" in context.extensions:
        return _integers(NVX_CURRENT_AVAILABLE_VIDMEM, 1)[0] * 1024
    if "GL_ATI_meminfo" in context.extensions:
        return _integers(ATI_VBO_FREE_MEMORY, 4)[0] * 1024
    return UNKNOWN


def named_block_bytes(context: moderngl.Context) -> int:
    """GL_MAX_SHADER_STORAGE_BLOCK_SIZE."""
    named = int(context.info.get("GL_MAX_SHADER_STORAGE_BLOCK_SIZE") or GUARANTEED_BLOCK_BYTES)
    return max(named % (1 << 32), GUARANTEED_BLOCK_BYTES)  # 4 GiB - 1 arrives as -1


def largest_block_bytes(context: moderngl.Context) -> int:
    """The largest storage buffer that a shader of this driver can read."""
    named = named_block_bytes(context)
    return max(named, SOFTWARE_BLOCK_BYTES) if is_software(context) else named


def is_software(context: moderngl.Context) -> bool:
    """Whether the processor does the device's work."""
    return any(name in context.info["GL_RENDERER"].lower() for name in ("llvmpipe", "softpipe", "swrast"))


def _integers(name: int, count: int) -> list[int]:
    """glGetIntegerv, which moderngl does not offer for names it does not know."""
    values = (ctypes.c_int * count)()
    _library().glGetIntegerv(ctypes.c_uint(name), values)
    return [value % (1 << 32) for value in values]


@cache
def _library() -> ctypes.CDLL:
    return ctypes.CDLL("libGL.so.1")
