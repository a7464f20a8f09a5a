"""Jobs done by the workers of a Dask scheduler; weft itself schedules nothing.

Units are the stages before the picture (a frame each), parts of a volume's tiles, and shares of the picture.
Each is a `weft` command that leaves files in the output folder, which all machines must see under the same
path. Dask gives the units of a worker that died to another one; a unit that is done again makes the same
files, and one that was begun goes on from what it left. The shares are merged here.
"""

from __future__ import annotations

import ctypes
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from weft.files.errors import InputError

from .config import load
from .frames import keep_picture, warning_of_turning
from .job import Job
from .openjd import block_ranges
from .progress import Reporter
from .run import needed
from .shares import merge_files, share_file
from .stages import CHAIN

CONNECT_SECONDS = 20
RETRIES = 3
"""How often a unit is given to another worker."""
SLURM = "slurm"
SLURM_MEMORY = "8GB"
"""Of a Slurm job, unless dask's own configuration (jobqueue.slurm) says otherwise."""
PR_SET_PDEATHSIG = 1


@dataclass(frozen=True)
class ClusterWork:
    """What is to be done by others."""

    path: Path
    """Of the job."""
    overrides: tuple[str, ...]
    output: Path | None
    frames: tuple[int | None, ...] = (None,)
    blocks_per_task: int = 1
    voxel_parts: int = 1
    """Into how many units the tiles of a volume are cut."""

    def job(self, frame: int | None) -> Job:
        return load(self.path, self.overrides, self.output, frame=frame)

    def command(self, name: str, job: Job) -> list[str]:
        """`weft NAME` for this job, on any machine."""
        folder = job.output if job.frame is None else job.output.parent
        command = [name, str(job.path.resolve()), "--output", str(folder), "--progress", "plain"]
        frame = [] if job.frame is None else ["--frame", str(job.frame)]
        return [*command, *frame, *(part for value in self.overrides for part in ("--set", value))]


def run_on_cluster(work: ClusterWork, address: str, *, jobs: int, report: Reporter) -> list[Path]:
    """`weft run`: all stages of all frames, by the workers of the scheduler at `address`, or of Slurm jobs.

    Raises `InputError` without the package distributed, and where no scheduler answers.
    """
    return _done_on_cluster(work, address, jobs, report, stages_first=True)


def render_on_cluster(work: ClusterWork, address: str, *, jobs: int, report: Reporter) -> list[Path]:
    """`weft render`: the pictures of the volumes that are there."""
    return _done_on_cluster(work, address, jobs, report, stages_first=False)


def _done_on_cluster(
    work: ClusterWork, address: str, jobs: int, report: Reporter, *, stages_first: bool
) -> list[Path]:
    loaded = [work.job(frame) for frame in work.frames]
    if len(loaded) > 1 and (warning := warning_of_turning(*(job.config.yarns for job in loaded[:2]))):
        report.note(warning)
    ranges = [block_ranges(job, work.blocks_per_task) for job in loaded]
    with _client(address, jobs) as client, report.work("render") as progress:
        from distributed import as_completed

        units: list[Any] = []
        for job, blocks in zip(loaded, ranges, strict=True):
            first = _submit_stages(client, work, job) if stages_first else []
            render = [*work.command("render", job), "--resume"]
            units += first
            units += [_submit(client, [*render, "--blocks", one], after=first[-1:]) for one in blocks]
        for done, unit in enumerate(as_completed(units), start=1):
            unit.result()
            progress(done / len(units), f"{done} of {len(units)} units")
    return [
        _merged(picture, blocks, report)
        for job, blocks in zip(loaded, ranges, strict=True)
        for picture in CHAIN["render"].parts(job)
    ]


def _submit_stages(client: Any, work: ClusterWork, job: Job) -> list[Any]:
    """Units up to the volume; who waits for the last waits for all."""
    units: list[Any] = []
    for name in needed(job, CHAIN, ["render"]):
        if name in ("scattering", "render"):
            continue
        command = work.command(name, job)
        before = units[-1:]
        if name == "voxelize" and work.voxel_parts > 1:
            parts = [f"{part}/{work.voxel_parts}" for part in range(work.voxel_parts)]
            before = [_submit(client, [*command, "--part", part], after=before) for part in parts]
            units += before
        units.append(_submit(client, command, after=before))
    return units


def _submit(client: Any, command: Sequence[str], *, after: Sequence[Any]) -> Any:
    return client.submit(run_weft, command, list(after), pure=False, retries=RETRIES)


@contextmanager
def _client(address: str, jobs: int) -> Iterator[Any]:
    try:
        from distributed import Client
    except ImportError as error:
        raise InputError(
            "--cluster needs the package distributed.", hint="pip install weft[cluster]"
        ) from error
    if address == SLURM:
        with slurm_cluster(jobs) as cluster, Client(cluster) as client:
            yield client
        return
    try:
        client = Client(address, timeout=CONNECT_SECONDS)
    except (OSError, ValueError) as error:
        raise InputError(f"--cluster {address}: no scheduler answers ({error}).") from error
    with client:
        yield client


def slurm_cluster(jobs: int) -> Any:
    """A dask-jobqueue cluster of so many Slurm jobs, a worker of one unit at a time in each.

    Queue, account, walltime and more come from dask's configuration (~/.config/dask/jobqueue.yaml), as for
    any program that uses dask-jobqueue.
    """
    try:
        import dask
        from dask_jobqueue import SLURMCluster
    except ImportError as error:
        raise InputError(
            "--cluster slurm needs the package dask-jobqueue.", hint="pip install weft[cluster]"
        ) from error
    told = dask.config.get("jobqueue.slurm", {})
    cluster = SLURMCluster(
        cores=told.get("cores") or 1,
        processes=1,
        memory=told.get("memory") or SLURM_MEMORY,
        worker_extra_args=["--nthreads", "1"],
        job_name="weft",
    )
    cluster.scale(jobs=jobs)
    return cluster


def _merged(picture: Job, ranges: Sequence[str], report: Reporter) -> Path:
    image = picture.output / CHAIN["render"].outputs(picture)["image"]
    report.note(merge_files([share_file(picture, blocks, None) for blocks in ranges], image, partial=False))
    if picture.frame is not None:
        keep_picture(picture, [image.name])
    return image


def run_weft(arguments: Sequence[str], after: Sequence[None] = ()) -> None:
    """On a worker: the command, in a process of its own. Raises `RuntimeError` with what it complained of.

    `after`: results of units that come first.
    """
    done = subprocess.run(
        [sys.executable, "-m", "weft.pipeline.cli", *arguments],
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=_end_with_the_worker if sys.platform == "linux" else None,
    )
    if done.returncode:
        raise RuntimeError(f"weft {' '.join(arguments)} ended with {done.returncode}: {done.stderr[-2000:]}")


def _end_with_the_worker() -> None:
    """A unit that goes on when its worker is dead would hold the folder's lock against the next worker."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
