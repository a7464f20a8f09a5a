"""What the pipeline knows of a stage: what it reads, what it writes, and what decides its result."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .job import Job

Progress = Callable[[float, str], None]
"""`progress(fraction, detail)`, called by a stage a few times per second at most."""


@dataclass(frozen=True)
class StageWork:
    """All a stage gets to do its work."""

    job: Job
    inputs: Mapping[str, Path]
    """The files of earlier stages (or those the job names instead), by name."""
    outputs: Mapping[str, Path]
    """Where to write each result."""
    progress: Progress
    resume: bool = False
    """Whether to go on from a checkpoint, where the stage keeps any."""


@dataclass(frozen=True)
class StageInput:
    """A file that another stage makes, or that the job names in its place."""

    stage: str
    output: str
    """The name of that stage's output."""
    named_by: Callable[[Job], Path | None] = lambda job: None
    """The file that the job gives instead of the stage's output, if it does."""


@dataclass(frozen=True)
class Stage:
    """One step of the chain: a name, the tables and files that decide its result, and the work itself."""

    name: str
    tables: tuple[str, ...]
    """The job's tables that the stage needs; the first is its own."""
    inputs: Mapping[str, StageInput]
    outputs: Callable[[Job], Mapping[str, str]]
    """File names in the output folder, by output name. The first names the run record."""
    work: Callable[[StageWork], dict[str, Any]]
    """Reads the inputs, writes the outputs, and returns the report for the run record."""
    code: tuple[str, ...] = ()
    """Files and folders of the package whose code makes the result, such as "voxelize"."""
    libraries: tuple[str, ...] = ("numpy",)
    """Distributions whose versions go into the run record."""
    made_when_needed: bool = False
    """So quick that any stage that needs it makes it first."""
    parts: Callable[[Job], Sequence[Job]] = lambda job: [job]
    """The job once for each result of the stage, where it makes several, each fresh or stale by itself."""
    optional_tables: tuple[str, ...] = ()
    """Tables that the result depends on too, where the job has them."""

    other_settings: Callable[[Job], Mapping[str, Any]] = lambda job: {}
    """Values of other tables that the result depends on too."""

    def record_name(self, job: Job) -> str:
        first = next(iter(self.outputs(job).values()))
        return f"{Path(first).stem}.run.json"
