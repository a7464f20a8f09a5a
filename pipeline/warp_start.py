"""Starting Warp quietly."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager


def start_warp() -> None:
    """Start Warp without its own lines (its devices, a missing CUDA driver, each kernel it compiles)."""
    import warp

    warp.config.log_level = warp.LOG_ERROR
    with without_native_stderr():
        warp.init()


@contextmanager
def without_native_stderr() -> Iterator[None]:
    """Drop what native libraries write to standard error, which Python cannot intercept otherwise."""
    kept = os.dup(2)
    try:
        with open(os.devnull, "w") as nowhere:
            os.dup2(nowhere.fileno(), 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
