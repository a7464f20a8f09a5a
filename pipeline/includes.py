"""`include = ["shared.toml", …]`: the named files lie under the file that names them, later over earlier."""

from __future__ import annotations

import os
from pathlib import Path

from weft.files.errors import InputError
from weft.files.input_file import TextFromFile

from .merging import NOTHING, merge, without
from .messages import JobErrors, Problem, problem_from, shown
from .toml_source import Origin, TomlDocument, read_toml

MAX_DEPTH = 8


def read_with_includes(path: Path) -> TomlDocument:
    """The file's values over those of the files it includes. Raises `JobErrors` with all that is wrong."""
    problems: list[Problem] = []
    document = _read(path, None, (), problems)
    if problems:
        raise JobErrors(problems)
    return document


def _read(
    path: Path, named_at: Origin | None, including: tuple[Path, ...], problems: list[Problem]
) -> TomlDocument:
    key = ("include",) if named_at else ()
    chain = (*including, Path(os.path.realpath(path)))
    if chain[-1] in including:
        loop = " -> ".join(shown(file) for file in chain[including.index(chain[-1]) :])
        problems.append(Problem(named_at, key, f"files include each other: {loop}"))
        return NOTHING
    if len(including) > MAX_DEPTH:
        problems.append(Problem(named_at, key, f"includes go more than {MAX_DEPTH} files deep"))
        return NOTHING
    try:
        document = read_toml(path)
    except InputError as error:
        problems.append(problem_from(error, named_at, key))
        return NOTHING
    below = NOTHING
    for name, origin in _included_names(document, path, problems):
        below = merge(below, _read(Path(name.folder, name), origin, chain, problems))
    return merge(below, without(document, "include"))


def _is_name(value: object) -> bool:
    return isinstance(value, TextFromFile) and "\0" not in value


def _included_names(
    document: TomlDocument, path: Path, problems: list[Problem]
) -> list[tuple[TextFromFile, Origin]]:
    names = document.table.get("include", [])
    if not isinstance(names, list) or not all(map(_is_name, names)):
        what = 'must be a list of files, as in include = ["cotton.toml"]'
        problems.append(Problem(document.origin(("include",)), ("include",), what))
        return []
    return [(name, document.origin(("include", index)) or Origin(path)) for index, name in enumerate(names)]
