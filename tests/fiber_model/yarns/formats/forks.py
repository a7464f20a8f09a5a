"""USD's readers in forks of the tests' process, which takes 0.03 s in place of 0.7."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from weft.fiber_model.yarns.formats import usd_stage

PROCESSOR_SECONDS = 5.0
"""Of a fork, at most. By the clock it may take longer, where the disk or the processors are busy."""
MOST_SECONDS = 60
PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")


def in_forks(main: Callable[..., int]) -> Callable[..., subprocess.CompletedProcess[bytes]]:
    """What `subprocess.run` would do with the program whose `main` this is, without starting Python again."""

    def run(command: list[str], *, timeout: float, **_: Any) -> subprocess.CompletedProcess[bytes]:
        output, sink = os.pipe()
        child = os.fork()
        if child == 0:
            os.dup2(sink, 1)
            os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
            sys.stdout = os.fdopen(1, "w")  # pytest has its own
            usd_stage.MEMORY_BYTES += int(Path("/proc/self/statm").read_text().split()[0]) * PAGE_BYTES
            signal.setitimer(signal.ITIMER_PROF, PROCESSOR_SECONDS)
            signal.alarm(MOST_SECONDS)
            code = 1
            try:
                code = main(*command[4:])
                sys.stdout.flush()
            finally:
                os._exit(code)
        os.close(sink)
        with os.fdopen(output, "rb") as file:
            said = file.read()
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        if code in (-signal.SIGALRM, -signal.SIGPROF):
            raise subprocess.TimeoutExpired(command, timeout)
        return subprocess.CompletedProcess(command, code, said, b"")

    return run
