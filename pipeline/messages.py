"""What is wrong with a job, one line for each mistake: `file:line: key: what; did you mean 'x'?`"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from weft.files.errors import InputError
from weft.files.suggestions import did_you_mean as did_you_mean

from .toml_source import KeyPath, Origin, TomlDocument, dotted

CONTROL_CHARACTERS = {code: repr(chr(code))[1:-1] for code in (*range(32), *range(127, 160))}
"""Shown as escapes: a value with a line break in it must not break the line, nor a terminal obey it."""


@dataclass(frozen=True)
class Problem:
    """One mistake and where it stands."""

    origin: Origin | None
    key: KeyPath
    what: str

    def line(self) -> str:
        parts = (place(self.origin) if self.origin else "", dotted(self.key), self.what)
        return ": ".join(part for part in parts if part).translate(CONTROL_CHARACTERS)


class JobErrors(InputError):
    """All that is wrong with a job, one line each."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(dict.fromkeys(problem.line() for problem in problems)))


def problem_from(error: InputError, origin: Origin | None = None, key: KeyPath = ()) -> Problem:
    """An error of a file that another file names: its own line says more than the place naming it."""
    return Problem(None if error.path else origin, () if error.path else key, shown_paths(error))


def shown_paths(error: InputError) -> str:
    """The message with the file's path as the user would write it here."""
    text = str(error)
    if error.path is not None and text.startswith(str(error.path)):
        return shown(error.path) + text[len(str(error.path)) :]
    return text


@contextmanager
def placed_in(document: TomlDocument) -> Iterator[None]:
    """Errors of a stage that begin with a key of the job, `yarns.warp_per_cm: …`, get the line of the key."""
    try:
        yield
    except InputError as error:
        what = f"{error.place}: {error.what}" if error.place else error.what
        found = re.match(r"[a-z_]+(\.[a-z_]+)*(?=: )", what)
        origin = document.origin(tuple(found[0].split("."))) if found else None
        if error.path is not None or origin is None or origin.path is None or isinstance(error, JobErrors):
            raise
        placed = type(error)(what, path=origin.path, place=origin.line or "", hint=error.hint)
        raise placed from error


def place(origin: Origin) -> str:
    """`configs/twill.toml:14`, or the option that gave the value."""
    if origin.path is None:
        return origin.option
    return f"{shown(origin.path)}:{origin.line}" if origin.line else shown(origin.path)


def shown(path: Path) -> str:
    """Relative to the working folder where it lies below, absolute elsewhere."""
    absolute = os.path.abspath(path)
    here = os.getcwd()
    return os.path.relpath(absolute, here) if absolute.startswith(here.rstrip("/") + "/") else absolute
