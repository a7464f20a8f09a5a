"""How a run is shown: bars on a terminal, plain lines in a log, JSON lines for a program."""

from __future__ import annotations

import json
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol, TextIO

if TYPE_CHECKING:
    from rich.progress import Progress as RichProgress

    from .stage import Progress

SHOW_AFTER_SECONDS = 1.0
"""Shorter work needs no bar."""


class Reporter(Protocol):
    """Where a run says what it does."""

    def note(self, text: str) -> None:
        """One line about the run."""

    def finished(self, stage: str, seconds: float, result: str, outputs: list[str]) -> None:
        """A stage is done; `result` says in a few words what it made."""

    def work(self, stage: str) -> Any:
        """A context manager around a stage's work; it yields the stage's progress callback."""


def reporter(kind: str = "auto", stream: TextIO | None = None) -> Reporter:
    """`bar`, `plain` or `json`; `auto` is a bar on a terminal and plain lines elsewhere."""
    if kind == "json":
        return JsonReporter(stream or sys.stdout)
    stream = stream or sys.stderr
    if kind == "bar" or (kind == "auto" and stream.isatty()):
        return BarReporter(stream)
    return PlainReporter(stream)


@dataclass
class _Clock:
    """Time spent on a stage and the time it will still take."""

    started: float = field(default_factory=lambda: time.monotonic())

    @property
    def elapsed(self) -> float:
        return time.monotonic() - self.started

    def remaining(self, fraction: float) -> float | None:
        """From the pace so far; None at first, when loading and compiling would be taken for the pace."""
        return self.elapsed * (1 - fraction) / fraction if fraction > 0.05 else None


@dataclass
class _LineReporter:
    """What bars and plain lines say alike: whole lines for people."""

    stream: TextIO

    def note(self, text: str) -> None:
        print(text, file=self.stream, flush=True)

    def finished(self, stage: str, seconds: float, result: str, outputs: list[str]) -> None:
        self.note(_finished_line(stage, seconds, result, outputs))


@dataclass
class PlainReporter(_LineReporter):
    """A line now and then: the first after a second, the next ones each time later by half."""

    @contextmanager
    def work(self, stage: str) -> Iterator[Progress]:
        clock = _Clock()
        next_line = SHOW_AFTER_SECONDS

        def progress(fraction: float, detail: str = "") -> None:
            nonlocal next_line
            if clock.elapsed >= next_line and fraction < 1:
                next_line = max(clock.elapsed * 1.5, clock.elapsed + 2)
                self.note(f"{stage}: {fraction:4.0%} {_times(clock, fraction)}{' ' * bool(detail)}{detail}")

        yield progress


@dataclass
class JsonReporter:
    """One JSON object a line: `event` is note, progress or finished."""

    stream: TextIO
    interval_seconds: float = 0.2

    def _line(self, event: str, **values: Any) -> None:
        print(json.dumps({"event": event, **values}), file=self.stream, flush=True)

    def note(self, text: str) -> None:
        self._line("note", text=text)

    def finished(self, stage: str, seconds: float, result: str, outputs: list[str]) -> None:
        self._line("finished", stage=stage, seconds=round(seconds, 3), result=result, outputs=outputs)

    @contextmanager
    def work(self, stage: str) -> Iterator[Progress]:
        clock = _Clock()
        next_line = 0.0

        def progress(fraction: float, detail: str = "") -> None:
            nonlocal next_line
            if clock.elapsed >= next_line or fraction >= 1:
                next_line = clock.elapsed + self.interval_seconds
                self._line(
                    "progress",
                    stage=stage,
                    fraction=round(fraction, 4),
                    detail=detail,
                    elapsed_seconds=round(clock.elapsed, 3),
                    remaining_seconds=_rounded(clock.remaining(fraction)),
                )

        yield progress


@dataclass
class BarReporter(_LineReporter):
    """A bar with the time left for work over a second, also before the work reports anything."""

    @contextmanager
    def work(self, stage: str) -> Iterator[Progress]:
        bar = _rich_bar(self.stream)
        task = bar.add_task(stage, total=None, detail="")
        appears = threading.Timer(SHOW_AFTER_SECONDS, bar.start)
        appears.daemon = True
        appears.start()

        def progress(fraction: float, detail: str = "") -> None:
            bar.update(task, total=1.0, completed=fraction, detail=detail)

        try:
            yield progress
        finally:
            appears.cancel()
            appears.join()
            bar.stop()


def _rich_bar(stream: TextIO) -> RichProgress:
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        TaskProgressColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        TextColumn("{task.fields[detail]}", style="dim"),
    )
    # the pace of the last five minutes, so that slow first steps such as compilation are forgotten
    console = Console(file=stream, force_terminal=True)
    return Progress(*columns, console=console, transient=True, speed_estimate_period=300)


def _finished_line(stage: str, seconds: float, result: str, outputs: list[str]) -> str:
    return f"{stage}: {result or 'done'} ({duration(seconds)}) -> {', '.join(outputs)}"


def _times(clock: _Clock, fraction: float) -> str:
    remaining = clock.remaining(fraction)
    left = "" if remaining is None else f", about {duration(remaining)} left"
    return f"({duration(clock.elapsed)}{left})"


def _rounded(seconds: float | None) -> float | None:
    return None if seconds is None else round(seconds, 3)


def duration(seconds: float) -> str:
    """`0.3 s`, `12 s`, `4 min 05 s`, `2 h 10 min`."""
    if seconds < 10:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes == 0:
        return f"{rest} s"
    return f"{minutes} min {rest:02d} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"
