"""A process that watches another one render, because a driver that hangs lets nobody in its process notice.

The work runs in a child. Where a dispatch does not end, the child is killed and another one goes on from the
checkpoint; when that hangs too, the run ends with exit code 4. Signals are passed on; if the watching process
is killed, the kernel kills the child.
"""

from __future__ import annotations

import ctypes
import os
import select
import signal
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from weft.files.errors import DeviceMemoryError

ATTEMPTS = 2
LOOK_SECONDS = 0.5
IDLE_FACTOR = 15
"""A dispatch of a software driver may wait so many times longer for a processor."""
PR_SET_PDEATHSIG = 1
TICKS = os.sysconf("SC_CLK_TCK")


def watched(arguments: Sequence[str], work: Callable[[Sequence[str]], int]) -> int:
    """Exit code of `work(arguments)`, done in a child; once more with --resume where it hangs."""
    for attempt in range(ATTEMPTS):
        again = [] if attempt == 0 or "--resume" in arguments else ["--resume"]
        code = _attempt([*arguments, *again], work)
        if code is not None:
            return code
        rest = "going on from the checkpoint" if attempt + 1 < ATTEMPTS else "giving up"
        print(f"weft: the device did not finish its work in time; {rest}", file=sys.stderr, flush=True)
    return DeviceMemoryError.exit_code


def _attempt(arguments: Sequence[str], work: Callable[[Sequence[str]], int]) -> int | None:
    """None where the child was killed because it hung."""
    reader, writer = os.pipe()
    sys.stdout.flush()
    sys.stderr.flush()
    watcher = os.getpid()
    child = os.fork()
    if child == 0:
        os.close(reader)
        _work_as_child(writer, arguments, work, watcher)
    os.close(writer)
    forwarded = (signal.SIGINT, signal.SIGTERM)
    previous = {number: signal.signal(number, lambda n, frame: _pass_on(child, n)) for number in forwarded}
    try:
        return _watch(child, reader)
    finally:
        os.close(reader)
        for number, handler in previous.items():
            signal.signal(number, handler)


def _work_as_child(
    writer: int, arguments: Sequence[str], work: Callable[[Sequence[str]], int], watcher: int
) -> None:
    """Never returns."""
    from weft.renderer.heartbeat import beat_into

    code = 1
    try:
        os.setpgid(0, 0)  # so that Ctrl-C on a terminal comes once, from the watcher
        if sys.platform == "linux":
            ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != watcher:
            os._exit(code)
        beat_into(writer)
        code = work(arguments)
    except SystemExit as stop:
        code = stop.code if isinstance(stop.code, int) else 1
    except BaseException:
        sys.excepthook(*sys.exc_info())
    finally:
        try:
            sys.stdout.flush()
            sys.stderr.flush()
        finally:
            os._exit(code)


def _pass_on(child: int, number: int) -> None:
    try:
        os.kill(child, number)
    except ProcessLookupError:
        return


@dataclass
class _Dispatch:
    """One that has begun."""

    clock: str
    limit: float
    wall: float
    cpu: float

    def hangs(self, child: int) -> bool:
        """Whether it takes too long by its clock, or far too long."""
        waited = time.monotonic() - self.wall
        if self.clock == "wall":
            return waited > self.limit
        return _cpu_seconds(child) - self.cpu > self.limit or waited > self.limit * IDLE_FACTOR


def _watch(child: int, reader: int) -> int | None:
    dispatch, text = None, ""
    while True:
        ready, _, _ = select.select([reader], [], [], LOOK_SECONDS)
        if ready:
            received = os.read(reader, 1 << 16).decode()
            if not received:
                return _exit_code(child)
            *lines, text = (text + received).split("\n")
            if lines:
                dispatch = _begun(lines[-1], child)
        elif dispatch is not None and dispatch.hangs(child):
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return None


def _begun(line: str, child: int) -> _Dispatch | None:
    if not line.startswith("+"):
        return None
    clock, limit = line[1:].split()
    return _Dispatch(clock, float(limit), time.monotonic(), _cpu_seconds(child))


def _exit_code(child: int) -> int:
    _, status = os.waitpid(child, 0)
    code = os.waitstatus_to_exitcode(status)
    return code if code >= 0 else 128 - code


def _cpu_seconds(child: int) -> float:
    """Of all threads of the child, where /proc tells; else of the clock on the wall."""
    try:
        fields = Path(f"/proc/{child}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / TICKS
    except OSError:
        return time.monotonic()
