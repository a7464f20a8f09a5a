"""Telling a watching process when a dispatch begins and ends. While a driver hangs, nothing else runs here.

One line per event: `+clock seconds` before a dispatch that is lost once it has taken so long, `-` after it.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

HANG_SECONDS = 8.0
"""Fifty times what a dispatch is meant to take."""
FIRST_SECONDS = 60.0
"""Of the empty one before the first of a program, since many drivers compile only then."""

_pipe: int | None = None
_share = 1.0


def beat_into(pipe: int, *, dispatch_share: float = 1.0) -> None:
    """From now on, write to this file descriptor; dispatches last so many times as long as usual."""
    global _pipe, _share
    _pipe, _share = pipe, dispatch_share


def dispatch_share() -> float:
    """How long dispatches are meant to last, relative to what they usually are: less after one that hung."""
    return _share


@contextmanager
def dispatching(*, software: bool, compiles: bool = False) -> Iterator[None]:
    """Around a dispatch. A software driver's time is that of its processor, which others may use as well."""
    if _pipe is None:
        yield
        return
    limit = max(FIRST_SECONDS, HANG_SECONDS) if compiles else HANG_SECONDS
    os.write(_pipe, f"+{'cpu' if software else 'wall'} {limit}\n".encode())
    yield
    os.write(_pipe, b"-\n")
