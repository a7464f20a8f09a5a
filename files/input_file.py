"""Paths in config models: relative to the file that names them; inputs must exist before work starts."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator
from pydantic_core import PydanticCustomError

SHOWN_PATH_LENGTH = 200


class TextFromFile(str):
    """A string read from a config file; it remembers the folder that its relative paths start from."""

    folder: Path

    def __new__(cls, text: str, folder: Path) -> TextFromFile:
        value = super().__new__(cls, text)
        value.folder = folder
        return value


def _resolve_against_its_file(value: Any) -> Any:
    if isinstance(value, TextFromFile):
        if "\0" in value:
            raise PydanticCustomError("input_file", "no path can hold a null character")
        # the full path, with "~" for the home folder; symbolic links stay as the user wrote them
        try:
            return Path(value.folder, Path(str(value)).expanduser())
        except RuntimeError as error:  # "~name" of nobody
            raise PydanticCustomError(
                "input_file", "there is no such home folder: {path}", {"path": str(value)}
            ) from error
    return value


def _must_be_a_file(path: Path) -> Path:
    try:
        if path.is_file():
            return path
        is_folder = path.is_dir()
    except OSError as error:
        raise PydanticCustomError(
            "input_file", "{reason}: {path}", {"path": _shortened(str(path)), "reason": _reason(error)}
        ) from error
    if is_folder:
        raise PydanticCustomError("input_file", "{path} is a folder, not a file", {"path": str(path)})
    raise PydanticCustomError(
        "input_file",
        "file not found: {path}{suggestion}",
        {"path": str(path), "suggestion": _similar_name(path)},
    )


def _reason(error: OSError) -> str:
    text = error.strerror or "cannot be opened"
    return text[0].lower() + text[1:]


def _shortened(text: str) -> str:
    return text if len(text) <= SHOWN_PATH_LENGTH else f"{text[:SHOWN_PATH_LENGTH]}…"


def _similar_name(path: Path) -> str:
    """`; did you mean 'x'?` for a file of nearly this name in the same folder, or what ails the folder."""
    try:
        names = [entry.name for entry in path.parent.iterdir()]
    except OSError:
        return "; its folder does not exist"
    close = difflib.get_close_matches(path.name, names, n=1)
    return f"; did you mean '{close[0]}'?" if close else ""


InputFile = Annotated[Path, BeforeValidator(_resolve_against_its_file), AfterValidator(_must_be_a_file)]
"""An existing file. From a config file: relative to that file's folder. From Python: a plain path."""

OutputPath = Annotated[Path, BeforeValidator(_resolve_against_its_file)]
"""A place to write to, which need not exist yet. Relative to the config file's folder likewise."""
