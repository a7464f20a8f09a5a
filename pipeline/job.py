"""A job as it is read: the values of its file, includes, presets and the command line, all checked."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from .frames import at_frame, frame_folder
from .includes import read_with_includes
from .merging import without
from .messages import JobErrors, Problem
from .overrides import apply_overrides
from .presets import apply_presets
from .toml_source import TomlDocument
from .validation import problems_of


@dataclass(frozen=True)
class Job:
    """A checked job and where its results go."""

    path: Path
    config: Any
    """The `JobConfig`, or another model with its tables as fields."""
    document: TomlDocument
    """The values before validation, with the place where each was written."""
    output: Path
    """Folder of the results."""
    frame: int | None = None
    """Which frame of a sequence this is, if it is of one."""

    @property
    def name(self) -> str:
        return self.path.stem

    def table(self, name: str) -> Any:
        """The config of a table that the job has."""
        config = getattr(self.config, name)
        assert config is not None, f"[{name}] is missing; the run checks that before a stage asks"
        return config

    def has(self, name: str) -> bool:
        return getattr(self.config, name, None) is not None


def load_job(
    path: Path,
    overrides: Sequence[str] = (),
    *,
    model: type[BaseModel],
    output: Path | None = None,
    only: Sequence[str] = (),
    pending_fit: Path | None = None,
    frame: int | None = None,
) -> Job:
    """Raises `InputError` with one line for every mistake in the job. `only`: look at these tables alone.

    `frame`: of a sequence, with results in a folder of its own below those of the job.

    `pending_fit`: a file of fitted parameters that need not be there yet; a preset stands in for it.
    """
    document = read_job(path, overrides)
    for name in [name for name in document.table if only and name not in only]:
        document = without(document, name)
    problems: list[Problem] = []
    if frame is not None:
        document = at_frame(document, frame)
    document = apply_presets(document, problems, pending_fit=pending_fit)
    try:
        config = model.model_validate(document.table)
    except ValidationError as error:
        problems += _not_caused_by_presets(problems_of(error, model, document, path), problems)
    if problems:
        raise JobErrors(problems)
    folder = Path(os.path.abspath(output or _output_folder(path, config, document)))
    return Job(path, config, document, folder if frame is None else folder / frame_folder(frame), frame)


def read_job(path: Path, overrides: Sequence[str] = ()) -> TomlDocument:
    """The values of a job file, its includes and the command line, before presets and validation."""
    return apply_overrides(read_with_includes(path), overrides)


def _not_caused_by_presets(found: list[Problem], presets: list[Problem]) -> list[Problem]:
    """Without a preset's values its table lacks keys; only the preset's name is the mistake."""
    tables = [problem.key[:-1] for problem in presets]
    return [problem for problem in found if not any(problem.key[: len(table)] == table for table in tables)]


def _output_folder(path: Path, config: Any, document: TomlDocument) -> Path:
    """`[output] folder`, or `<job name>.out` beside the job.

    A job may come from somebody else: its file can only name a folder below its own, and only the command
    line can send results elsewhere.
    """
    folder: Path | None = getattr(getattr(config, "output", None), "folder", None)
    home = path.resolve().parent
    if folder is None:
        return home / f"{path.stem}.out"
    key = ("output", "folder")
    origin = document.origin(key)
    if origin is not None and origin.path is None:
        return folder
    real = Path(os.path.realpath(folder))
    if not real.is_relative_to(home) or real == home:
        what = f"leads to {real}, outside the job's folder; give --output to write there"
        raise JobErrors([Problem(origin, key, what)])
    return folder
