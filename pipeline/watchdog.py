"""A process that watches another one render, because a driver that hangs lets nobody in its process notice.

The work runs in a child. Where a dispatch does not end, the child is killed and another one goes on from the
checkpoint, with dispatches half as long; when the third hangs too, the run ends with exit code 4. Signals are
passed on; if the watching process is killed, the kernel kills the child.

A dispatch of a GPU is measured by the clock on the wall. One of a software driver shares its processors with
others: it hangs once it has used `HANG_SECONDS` of them, or has slept as long, neither running nor waiting
for a processor or a disk. Neither happens to work that a busy machine merely holds up.
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

ATTEMPTS = 3
LOOK_SECONDS = 0.5
IDLE_FACTOR = 15
"""So many times longer may a dispatch of a software driver take where nothing tells who sleeps."""
PR_SET_PDEATHSIG = 1
PROC = Path("/proc")
TICKS = os.sysconf("SC_CLK_TCK")


def watched(arguments: Sequence[str], work: Callable[[Sequence[str]], int]) -> int:
    """Exit code of `work(arguments)`, done in a child; again with --resume where it hangs."""
    for attempt in range(ATTEMPTS):
        again = [] if attempt == 0 or "--resume" in arguments else ["--resume"]
        code = _attempt([*arguments, *again], work, dispatch_share=0.5**attempt)
        if code is not None:
            return code
        rest = "going on from the checkpoint" if attempt + 1 < ATTEMPTS else "giving up"
        print(f"weft: the device did not finish its work in time; {rest}", file=sys.stderr, flush=True)
    return DeviceMemoryError.exit_code


def _attempt(
    arguments: Sequence[str], work: Callable[[Sequence[str]], int], *, dispatch_share: float
) -> int | None:
    """None where the child was killed because it hung."""
    reader, writer = os.pipe()
    sys.stdout.flush()
    sys.stderr.flush()
    watcher = os.getpid()
    child = os.fork()
    if child == 0:
        os.close(reader)
        _work_as_child(writer, arguments, work, watcher, dispatch_share)
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
    writer: int,
    arguments: Sequence[str],
    work: Callable[[Sequence[str]], int],
    watcher: int,
    dispatch_share: float,
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
        beat_into(writer, dispatch_share=dispatch_share)
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
    began: float
    cpu: float
    looked: float
    active: float | None
    """Seconds that the child's threads have run or waited for a processor, when it was looked at last."""
    asleep: float = 0.0

    def hangs(self, child: int) -> bool:
        """Whether it takes too long."""
        now = time.monotonic()
        if self.clock == "wall":
            return now - self.began > self.limit
        active = _active_seconds(child)
        if active is None or self.active is None:
            slept_too_long = now - self.began > self.limit * IDLE_FACTOR
        else:
            step = now - self.looked
            if not _waits_for_a_disk(child):
                self.asleep += min(max(step - (active - self.active), 0.0), step)
            slept_too_long = self.asleep > self.limit
        self.looked, self.active = now, active
        return slept_too_long or _cpu_seconds(child) - self.cpu > self.limit


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
    now = time.monotonic()
    return _Dispatch(clock, float(limit), now, _cpu_seconds(child), now, _active_seconds(child))


def _exit_code(child: int) -> int:
    _, status = os.waitpid(child, 0)
    code = os.waitstatus_to_exitcode(status)
    return code if code >= 0 else 128 - code


def _cpu_seconds(child: int) -> float:
    """Of all threads of the child, where /proc tells; else of the clock on the wall."""
    try:
        fields = (PROC / f"{child}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / TICKS
    except OSError:
        return time.monotonic()


def _active_seconds(child: int) -> float | None:
    """That its threads have run, or waited for a processor; None where the system does not tell."""
    try:
        texts = [path.read_text() for path in (PROC / f"{child}/task").glob("*/schedstat")]
    except OSError:
        return None
    times = [text.split() for text in texts]
    return sum(int(ran) + int(waited) for ran, waited, _ in times) / 1e9 if times else None


def _waits_for_a_disk(child: int) -> bool:
    """Whether one of its threads does, as when memory is swapped."""
    try:
        texts = [path.read_text() for path in (PROC / f"{child}/task").glob("*/stat")]
    except OSError:
        return False
    return any(text.rpartition(")")[2].split()[0] == "D" for text in texts)
