"""Where the browser's threads leave what is wanted, and the rendering thread takes it."""

from __future__ import annotations

import threading
from collections.abc import Callable

from .look import Look


class Desk:
    """The look that is wanted now. Changes come from any thread."""

    def __init__(self, look: Look) -> None:
        self._look, self._version = look, 0
        self._changed = threading.Condition()

    def change(self, step: Callable[[Look], Look]) -> None:
        """Replace the look by what `step` makes of it; the same look is no change."""
        with self._changed:
            look = step(self._look)
            if look != self._look:
                self._look = look
                self._version += 1
                self._changed.notify_all()

    def take(self) -> tuple[Look, int]:
        """The look and its version."""
        with self._changed:
            return self._look, self._version

    @property
    def look(self) -> Look:
        return self._look

    def call(self) -> None:
        """Count as a change though the look is the same: somebody new wants to see it."""
        with self._changed:
            self._version += 1
            self._changed.notify_all()

    def wait_past(self, version: int, seconds: float) -> bool:
        """Wait for a change; whether there is one."""
        with self._changed:
            return self._changed.wait_for(lambda: self._version != version, timeout=seconds)
