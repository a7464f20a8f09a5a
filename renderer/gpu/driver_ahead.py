"""The driver, loaded by another thread while this one reads its modules.

A driver of Mesa brings LLVM along, 40 ms of linking that need no Python. What goes wrong here goes wrong once
more, with its words, where the context is made (context.py).
"""

from __future__ import annotations

import ctypes
import threading

EGL_PLATFORM_DEVICE = 0x313F
"""Of EGL_EXT_platform_device: a display is a device, as in context.py."""
MAX_DEVICES = 1
"""The first one is the one that contexts are made on."""


def load_driver_ahead() -> None:
    """Return at once."""
    threading.Thread(target=_initialize_display, daemon=True).start()


def _initialize_display() -> None:
    try:
        egl = ctypes.CDLL("libEGL.so.1")
        address = egl.eglGetProcAddress
    except (OSError, AttributeError):
        return
    address.restype, address.argtypes = ctypes.c_void_p, [ctypes.c_char_p]
    pointer, number = ctypes.c_void_p, ctypes.POINTER(ctypes.c_int)
    find = address(b"eglQueryDevicesEXT")
    open_display = address(b"eglGetPlatformDisplayEXT")
    initialize = address(b"eglInitialize")
    if not (find and open_display and initialize):
        return
    device, count = (pointer * MAX_DEVICES)(), ctypes.c_int()
    ctypes.CFUNCTYPE(ctypes.c_uint, ctypes.c_int, pointer, number)(find)(MAX_DEVICES, device, count)
    if count.value:
        kind = ctypes.c_uint
        display = ctypes.CFUNCTYPE(pointer, kind, pointer, pointer)(open_display)(
            EGL_PLATFORM_DEVICE, device[0], None
        )
        ctypes.CFUNCTYPE(kind, pointer, pointer, pointer)(initialize)(display, None, None)
