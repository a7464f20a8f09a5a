"""One headless OpenGL 4.3 context per process, through EGL."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import moderngl

from weft.files.errors import InputError

REQUIRED_VERSION = 430

# soname with its version: the unversioned names belong to the -dev packages
_LIBRARIES: tuple[dict[str, Any], ...] = ({"libegl": "libEGL.so.1", "libgl": "libGL.so.1"}, {})


@lru_cache(maxsize=1)
def shared_context() -> moderngl.Context:
    """The context of this process. Raises `InputError` where OpenGL 4.3 cannot be had without a display."""
    context = _create_context()
    if context.version_code < REQUIRED_VERSION:
        found = f"{context.info['GL_RENDERER']} offers OpenGL {context.version_code / 100:.1f}"
        raise InputError(f"render: {found}; compute shaders need 4.3.", hint="Use a newer driver or Mesa.")
    context.gc_mode = "auto"
    return context


def device_name(context: moderngl.Context) -> str:
    """Driver and version as the driver spells them, for run records."""
    return f"{context.info['GL_RENDERER']}, OpenGL {context.info['GL_VERSION']}"


def _create_context() -> moderngl.Context:
    failures = []
    for libraries in _LIBRARIES:
        try:
            return moderngl.create_context(**{"standalone": True, "backend": "egl", **libraries})
        except Exception as error:  # glcontext raises bare Exception
            failures.append(str(error))
    raise InputError(
        f"render: no OpenGL context through EGL ({'; '.join(failures)}).",
        hint="Install a driver with EGL, or Mesa's software one: apt install libegl1 libgl1 libgl1-mesa-dri",
    )
