"""`--set render.samples_per_pixel=64`: one value from the command line, over everything in the files.

The value is written as in TOML; what is not a TOML value is taken as text, so that a name needs no quotes.
Relative paths start from the folder the command is given in, since no file names them.
"""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .merging import merge, merge_values
from .messages import JobErrors, Problem
from .toml_source import MAX_DEPTH, KeyPath, Origin, TomlDocument, with_folder


def apply_overrides(document: TomlDocument, overrides: Sequence[str]) -> TomlDocument:
    """Raises `JobErrors` naming every override that is not of the form `key.key=value`."""
    problems: list[Problem] = []
    for text in overrides:
        origin = Origin(None, option=f"--set {text}")
        try:
            document = merge(document, _override(document.table, text, origin))
        except ValueError as error:
            problems.append(Problem(origin, (), str(error)))
    if problems:
        raise JobErrors(problems)
    return document


def _override(table: dict[str, Any], text: str, origin: Origin) -> TomlDocument:
    name, equals, value_text = text.partition("=")
    keys = [key.strip() for key in name.split(".")]
    if not equals or not all(keys):
        raise ValueError("write it as key.key=value, for example --set render.samples_per_pixel=64")
    if len(keys) > MAX_DEPTH:
        raise ValueError(f"no key of a job has more than {MAX_DEPTH} parts")
    value = with_folder(_parse(value_text.strip()), Path.cwd())
    path: KeyPath = tuple(int(key) if key.isdigit() else key for key in keys)
    return TomlDocument(_nested(table, path, value), {path[:end]: origin for end in range(1, len(path) + 1)})


def _parse(text: str) -> Any:
    try:
        parsed = tomllib.loads(f"value = {text}")
    except tomllib.TOMLDecodeError:
        return text
    return parsed["value"] if len(parsed) == 1 else text


def _nested(current: Any, path: KeyPath, value: Any) -> Any:
    """`value` wrapped into tables along `path`; an index replaces one element of an array that exists."""
    if not path:
        return value
    key, rest = path[0], path[1:]
    if isinstance(key, str):
        return {key: _nested(current.get(key) if isinstance(current, dict) else None, rest, value)}
    if not isinstance(current, list) or key >= len(current):
        count = len(current) if isinstance(current, list) else 0
        raise ValueError(f"there is no element {key}; the array has {count}")
    element = merge_values(current[key], _nested(current[key], rest, value))
    return [*current[:key], element, *current[key + 1 :]]
