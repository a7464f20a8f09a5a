"""Kill renders at random moments and let them resume: `kill_renders.py JOB KILLS SEED OPTIONS...`.

Each run, `weft render JOB OPTIONS... --resume`, is a fork of this process, which has imported all and read
the volume, so that it soon takes samples. Most are killed after they wrote a checkpoint, some at any time
from their start; the last one is let run to its end. Prints one line of JSON: how many were killed, how many
of them after they had written a checkpoint, how many ended before, and the seconds of it all.
"""

from __future__ import annotations

import json
import os
import random
import signal
import sys
import time
from pathlib import Path

from weft.pipeline import cli
from weft.pipeline.config import load
from weft.pipeline.picture_volume import picture_volume
from weft.renderer import daylight, exposure, merge, render  # noqa: F401  what a render imports
from weft.renderer.checkpoint import read_checkpoint
from weft.renderer.gpu import context  # noqa: F401

ANY_TIME = 0.2
"""Share of the runs that are killed at any time."""
START_SECONDS = 1.0
AFTER_SECONDS = 0.3


def start(arguments: list[str]) -> int:
    """The process id of a run."""
    child = os.fork()
    if child == 0:
        code = 1
        try:
            silent = os.open(os.devnull, os.O_WRONLY)
            os.dup2(silent, 1)
            code = cli.exit_code(arguments)
        finally:
            os._exit(code)
    return child


def ended(child: int) -> bool:
    """Whether it ended well; anything else ends this program."""
    pid, status = os.waitpid(child, os.WNOHANG)
    if pid and status:
        sys.exit(f"a run that was not killed ended with status {status}")
    return pid != 0


def wait(child: int, seconds: float, until=lambda: False) -> bool:
    """Until the condition holds, the time is over or the run has ended; whether it has ended."""
    end = time.monotonic() + seconds
    while time.monotonic() < end and not until():
        if ended(child):
            return True
        time.sleep(0.002)
    return ended(child)


def content(checkpoint: Path) -> int:
    """Which one it is: each is written as a new file."""
    return checkpoint.stat().st_mtime_ns if checkpoint.is_file() else 0


def main(path: Path, kills: int, seed: int, options: list[str]) -> None:
    job, chance, began = load(path, [], None), random.Random(seed), time.monotonic()
    picture_volume(job, job.output / "volume.vdb")
    checkpoint = job.output / "image.checkpoint.exr"
    arguments = ["render", str(path), *options, "--resume", "--force", "--progress", "plain"]
    outcome = {"kills": 0, "with_checkpoint": 0, "ended_before": 0}
    while outcome["kills"] < kills:
        before, child = content(checkpoint), start(arguments)
        written = lambda before=before: content(checkpoint) != before  # noqa: E731
        if chance.random() < ANY_TIME:
            over = wait(child, chance.uniform(0, START_SECONDS))
        else:
            over = wait(child, 60, written) or wait(child, chance.uniform(0, AFTER_SECONDS))
        if over:
            outcome["ended_before"] += 1
            checkpoint.unlink(missing_ok=True)
            continue
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        outcome["kills"] += 1
        outcome["with_checkpoint"] += written()
        if checkpoint.is_file():
            read_checkpoint(checkpoint)
    child = start(arguments)
    while not wait(child, 600):
        pass
    print(json.dumps(outcome | {"seconds": time.monotonic() - began}))


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), sys.argv[4:])
