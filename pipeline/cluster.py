"""A picture rendered by the workers of a Dask scheduler, share by share; weft itself schedules nothing.

Every task is a `weft render --blocks … --resume` that leaves a share in the output folder, which all machines
must see under the same path. Dask gives the tasks of a worker that died to another one; a task that was begun
goes on from its share. The shares are then merged here.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from weft.files.errors import InputError

from .job import Job
from .openjd import block_ranges
from .progress import Reporter
from .shares import merge_files, share_file
from .stages import CHAIN

CONNECT_SECONDS = 20
RETRIES = 3
"""How often a task is given to another worker."""


def render_on_cluster(
    job: Job, address: str, *, overrides: Sequence[str], blocks_per_task: int, report: Reporter
) -> list[Path]:
    """The pictures of the job, by the workers of the scheduler at `address`, such as tcp://host:8786.

    Raises `InputError` without the package distributed, and where no scheduler answers.
    """
    ranges = block_ranges(job, blocks_per_task)
    command = [
        "render",
        str(job.path.resolve()),
        "--output",
        str(job.output),
        "--resume",
        "--progress",
        "plain",
    ]
    command += [part for value in overrides for part in ("--set", value)]
    with _client(address) as client, report.work("render") as progress:
        from distributed import as_completed

        tasks = [
            client.submit(run_weft, [*command, "--blocks", blocks], pure=False, retries=RETRIES)
            for blocks in ranges
        ]
        for done, task in enumerate(as_completed(tasks), start=1):
            task.result()
            progress(done / len(tasks), f"{done} of {len(tasks)} shares")
    return [_merged(picture, ranges, report) for picture in CHAIN["render"].parts(job)]


def _client(address: str) -> Any:
    try:
        from distributed import Client
    except ImportError as error:
        raise InputError(
            "--cluster needs the package distributed.", hint="pip install weft[cluster]"
        ) from error
    try:
        return Client(address, timeout=CONNECT_SECONDS)
    except (OSError, ValueError) as error:
        raise InputError(f"--cluster {address}: no scheduler answers ({error}).") from error


def _merged(picture: Job, ranges: Sequence[str], report: Reporter) -> Path:
    image = picture.output / CHAIN["render"].outputs(picture)["image"]
    report.note(merge_files([share_file(picture, blocks, None) for blocks in ranges], image, partial=False))
    return image


def run_weft(arguments: Sequence[str]) -> None:
    """On a worker: the command, in a process of its own. Raises `RuntimeError` with what it complained of."""
    done = subprocess.run(
        [sys.executable, "-m", "weft.pipeline.cli", *arguments], capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise RuntimeError(f"weft {' '.join(arguments)} ended with {done.returncode}: {done.stderr[-2000:]}")
