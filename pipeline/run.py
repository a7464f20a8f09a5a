"""Running a job: which stages are needed, which of them are stale and why, and doing those."""

from __future__ import annotations

import datetime
import fcntl
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

from weft.files.errors import InputError

from .cache import StageKey, stage_key, stamp_of, why_stale
from .job import Job
from .messages import placed_in, shown
from .progress import Reporter
from .run_record import RunRecord, command_line, machine, seeds_in, versions_for, write_record
from .stage import Stage, StageWork

LOCK = ".lock"
Chain = Mapping[str, Stage]
"""All stages by name, each after those it needs."""


@dataclass(frozen=True)
class Outcome:
    """What became of one stage."""

    stage: str
    ran: bool
    why: str
    """Why it ran; empty where it was fresh."""


def run_chain(
    job: Job,
    chain: Chain,
    targets: Sequence[str],
    *,
    report: Reporter,
    force: bool = False,
    resume: bool = False,
) -> list[Outcome]:
    """Make the targets and all they need, skipping what is fresh."""
    with _alone_in(job.output, report):
        return [
            _freshen(chain[name], part, chain, report, force=force, resume=resume)
            for name in needed(job, chain, targets)
            for part in chain[name].parts(job)
        ]


def run_one(
    job: Job, chain: Chain, target: str, *, report: Reporter, force: bool = False, resume: bool = False
) -> Outcome:
    """Make one stage from the results of earlier stages as they are; they must exist.

    Of several results, what became of the last.
    """
    with _alone_in(job.output, report):
        for name in needed(job, chain, [target])[:-1]:
            if chain[name].made_when_needed:
                _freshen(chain[name], job, chain, report)
            else:
                _note_if_stale(chain[name], job, chain, report)
        stage = chain[target]
        parts = stage.parts(job)
        return [_freshen(stage, part, chain, report, force=force, resume=resume) for part in parts][-1]


def needed(job: Job, chain: Chain, targets: Sequence[str]) -> list[str]:
    """The targets and the stages whose results they read, in the order of the chain."""
    names = set(targets)
    for stage in reversed(list(chain.values())):
        if stage.name in names:
            _refuse_missing_tables(stage, job)
            names |= {source.stage for source in stage.inputs.values() if source.named_by(job) is None}
    return [name for name in chain if name in names]


def _refuse_missing_tables(stage: Stage, job: Job) -> None:
    missing = " and ".join(f"[{table}]" for table in stage.tables if not job.has(table))
    if missing:
        raise InputError(f"'{stage.name}' needs the table {missing}, which the job lacks", path=job.path)


def input_files(stage: Stage, job: Job, chain: Chain) -> dict[str, Path]:
    """The files that the stage reads. Raises `InputError` with the command to run where one is missing."""
    files = {}
    for name, source in stage.inputs.items():
        named = source.named_by(job)
        files[name] = named or job.output / chain[source.stage].outputs(job)[source.output]
        if not files[name].is_file():
            raise InputError(
                f"{stage.name}: {shown(files[name])} does not exist yet.",
                hint=f"Run 'weft {source.stage} {shown(job.path)}', or 'weft run {shown(job.path)}' for all.",
            )
    return files


def _freshen(
    stage: Stage, job: Job, chain: Chain, report: Reporter, *, force: bool = False, resume: bool = False
) -> Outcome:
    """Run the stage where it is stale."""
    inputs = input_files(stage, job, chain)
    key = stage_key(stage, job, inputs)
    why = "you asked for it" if force else why_stale(stage, job, key)
    if not why:
        report.note(f"{_shown_name(stage, job)}: fresh")
        return Outcome(stage.name, False, "")
    report.note(f"{_shown_name(stage, job)}: {'runs because' if force else 'stale because'} {why}")
    _run(stage, job, inputs, key, report, resume=resume)
    return Outcome(stage.name, True, why)


def _shown_name(stage: Stage, job: Job) -> str:
    """The stage's, and where it has several results the result's."""
    first = Path(next(iter(stage.outputs(job).values()))).stem
    return f"{stage.name} {first}" if first.startswith(f"{job.name}.") else stage.name


def _note_if_stale(stage: Stage, job: Job, chain: Chain, report: Reporter) -> None:
    outputs = stage.outputs(job).values()
    if not all((job.output / name).is_file() for name in outputs):
        return  # the stage that needs it will say so
    try:
        why = why_stale(stage, job, stage_key(stage, job, input_files(stage, job, chain)))
    except InputError as error:
        why = str(error)
    if why:
        report.note(f"note: {next(iter(outputs))} is used as it is, but it is stale: {why}")


def _run(
    stage: Stage, job: Job, inputs: Mapping[str, Path], key: StageKey, report: Reporter, *, resume: bool
) -> None:
    started, clock = datetime.datetime.now(datetime.UTC), time.monotonic()
    outputs = {name: job.output / file for name, file in stage.outputs(job).items()}
    with placed_in(job.document), report.work(stage.name) as progress:
        stage_report = stage.work(StageWork(job, inputs, outputs, progress, resume))
    seconds = time.monotonic() - clock
    write_record(
        job.output / stage.record_name(job),
        _record(stage, job, key, outputs, stage_report, started.isoformat(timespec="seconds"), seconds),
    )
    summary = str(stage_report.get("summary", ""))
    report.finished(stage.name, seconds, summary, [shown(path) for path in outputs.values()])


def _record(
    stage: Stage,
    job: Job,
    key: StageKey,
    outputs: Mapping[str, Path],
    report: dict[str, Any],
    started: str,
    seconds: float,
) -> RunRecord:
    names = [name for name in (*stage.tables, *stage.optional_tables) if job.has(name)]
    tables = {name: job.table(name).model_dump(mode="json") for name in names}
    stamps = {name: stamp_of(path) for name, path in outputs.items()}
    return RunRecord(
        stage=stage.name,
        key=key.values,
        config=tables,
        inputs=key.inputs,
        outputs={
            name: type(stamp)(Path(stamp.path).name, stamp.sha256, stamp.bytes)
            for name, stamp in stamps.items()
        },
        report=report,
        seeds=seeds_in(tables),
        versions=versions_for(stage.libraries),
        machine=machine(),
        command=command_line(),
        started=started,
        seconds=round(seconds, 3),
    )


@contextmanager
def _alone_in(folder: Path, report: Reporter) -> Iterator[None]:
    """One run at a time in an output folder; leftovers of killed runs are removed first.

    A folder that was not there and in which nothing was made is gone again afterwards.
    """
    new = not folder.exists()
    with _locked(folder, report):
        _remove_leftovers(folder)
        try:
            yield
        finally:
            (folder / LOCK).unlink(missing_ok=True)
            if new:
                with suppress(OSError):
                    folder.rmdir()


def _locked(folder: Path, report: Reporter) -> TextIO:
    """The lock's open file, which holds it until it is closed."""
    while True:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            lock = open(folder / LOCK, "w")  # noqa: SIM115  held until the run ends
        except OSError as error:
            raise InputError(f"cannot write here: {error.strerror}", path=shown(folder)) from error
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            lock.close()
            raise InputError("another weft run is working in this folder", path=shown(folder)) from error
        except OSError:
            report.note(f"note: {shown(folder)} cannot be locked; run one weft at a time in it")
            return lock
        # a run that ended meanwhile removed its lock: then what was locked here is no longer the folder's
        with suppress(OSError):
            if os.path.samestat(os.fstat(lock.fileno()), os.stat(folder / LOCK)):
                return lock
        lock.close()


def _remove_leftovers(folder: Path) -> None:
    """Temporary files of `atomic_write` (`.name.xxxxxxxx.suffix`) that a killed run left behind."""
    for file in folder.glob(".*.????????.*"):
        file.unlink(missing_ok=True)
