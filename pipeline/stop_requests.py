"""Ctrl-C and SIGTERM as a question that work asks now and then, so that it ends with its results in order."""

from __future__ import annotations

import signal
import threading
from types import TracebackType
from typing import NoReturn


class Terminated(Exception):
    """SIGTERM, as `KeyboardInterrupt` is SIGINT."""


def raise_for(number: int, frame: object = None, *, what: str = "") -> NoReturn:
    """A handler of signals. Raises `KeyboardInterrupt` or `Terminated`; `what` became of the work."""
    raise (KeyboardInterrupt if number == signal.SIGINT else Terminated)(what)


class StopRequests:
    """While entered, the first signal is only noted; a second one ends the work at once."""

    def __init__(self) -> None:
        self.received: int | None = None
        self.previous: dict[int, object] = {}

    def __call__(self) -> bool:
        """Whether to stop."""
        return self.received is not None

    def obey(self, what: str) -> None:
        """Once all is saved: raise what the signal would have raised, if there was one."""
        if self.received is not None:
            raise_for(self.received, what=what)

    def _note(self, number: int, frame: object) -> None:
        if self.received is not None:
            raise_for(number)
        self.received = number

    def __enter__(self) -> StopRequests:
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                self.previous[number] = signal.signal(number, self._note)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self.previous.items():
            signal.signal(number, handler)  # type: ignore[arg-type]
        self.previous = {}
