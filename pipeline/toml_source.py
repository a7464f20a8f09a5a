"""One TOML file with the line of every key, so that a message about a value can point at it.

`tomllib` gives the values and checks the grammar; the scan below only finds lines in text known to be valid.
"""

from __future__ import annotations

import bisect
import math
import re
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from weft.files.errors import InputError
from weft.files.input_file import TextFromFile

MAX_FILE_BYTES = 4 * 2**20
"""A job is a page or two; anything larger is not a job."""

MAX_DEPTH = 64
"""Tables and arrays within each other; a job has six. What walks a job may then do so by recursion."""

KeyPath = tuple[str | int, ...]
"""Where a value lies: table and key names, and indices into arrays."""


@dataclass(frozen=True)
class Origin:
    """Where a value was written: a file and line, or the command line."""

    path: Path | None
    line: int = 0
    option: str = ""
    """The command line's `--set …` that gave the value."""


@dataclass(frozen=True)
class TomlDocument:
    """A table of values and where each of them was written."""

    table: dict[str, Any]
    origins: dict[KeyPath, Origin]

    def origin(self, path: KeyPath) -> Origin | None:
        """Of the value itself, or of the nearest table around it that was written somewhere."""
        for end in range(len(path), 0, -1):
            if path[:end] in self.origins:
                return self.origins[path[:end]]
        return None


def read_toml(path: Path) -> TomlDocument:
    """Raises `InputError` with the line where the file is not valid TOML."""
    text = _read_text(path)
    try:
        table = tomllib.loads(text)
        lines = _LineScan(text).lines
    except tomllib.TOMLDecodeError as error:
        raise _syntax_error(path, error) from error
    except RecursionError as error:
        raise _nested_too_deeply(path) from error
    if any(len(key) > MAX_DEPTH for key in lines):
        raise _nested_too_deeply(path)
    origins = {key: Origin(path, line) for key, line in lines.items()}
    document = TomlDocument(with_folder(table, path.resolve().parent), origins)
    _refuse_non_finite(document, path)
    return document


def _read_text(path: Path) -> str:
    try:
        with path.open("rb") as file:
            data = file.read(MAX_FILE_BYTES + 1)  # devices and pipes do not tell their size
        if len(data) > MAX_FILE_BYTES:
            raise InputError("is too large; a config file has at most 4 MiB", path=path)
        return data.decode("utf-8-sig")  # some editors begin a file with a mark
    except UnicodeDecodeError as error:
        raise InputError("is not UTF-8 text, so it is not a TOML file", path=path) from error
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", path=path) from error


def _nested_too_deeply(path: Path) -> InputError:
    return InputError("nested too deeply for a config file", path=path)


def _syntax_error(path: Path, error: tomllib.TOMLDecodeError) -> InputError:
    found = re.fullmatch(r"(.*) \(at (?:line (\d+), column (\d+)|end of document)\)", str(error), re.DOTALL)
    if found is None:
        return InputError(f"not valid TOML: {error}", path=path)
    what, line, column = found.groups()
    where = f" (column {column})" if column else " at the end of the file"
    return InputError(f"not valid TOML: {what[0].lower()}{what[1:]}{where}", path=path, place=line or "")


def with_folder(value: Any, folder: Path) -> Any:
    """The same values, with each string remembering `folder`, where its relative path would start."""
    if isinstance(value, str):
        return TextFromFile(value, folder)
    if isinstance(value, dict):
        return {key: with_folder(item, folder) for key, item in value.items()}
    if isinstance(value, list):
        return [with_folder(item, folder) for item in value]
    return value


def _refuse_non_finite(document: TomlDocument, path: Path) -> None:
    for key, value in leaves(document.table):
        if isinstance(value, float) and not math.isfinite(value):
            origin = document.origin(key)
            raise InputError(
                f"{dotted(key)}: found {value}; numbers must be finite",
                path=path,
                place=origin.line if origin else "",
            )


def leaves(value: Any, path: KeyPath = ()) -> list[tuple[KeyPath, Any]]:
    """Every value below `value` that is neither table nor array, with its place."""
    if isinstance(value, dict):
        return [leaf for key, item in value.items() for leaf in leaves(item, (*path, key))]
    if isinstance(value, list):
        return [leaf for index, item in enumerate(value) for leaf in leaves(item, (*path, index))]
    return [(path, value)]


def dotted(path: KeyPath) -> str:
    """`render.lights[0].file`, as messages name a key."""
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else ("." if text else "") + part
    return text


class _LineScan:
    """Walks the text of a valid TOML file once and notes the line of each key and array element."""

    BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
    SPACE = re.compile(r"(?:[ \t\r\n]+|#[^\n]*)*")
    BLANK = re.compile(r"[ \t]*")
    SCALAR = re.compile(r"[^,\]}#\r\n]*")
    STRINGS = (
        re.compile(r'"""(?:\\.|[^\\])*?"{3,5}(?!")', re.DOTALL),
        re.compile(r"'''.*?'{3,5}(?!')", re.DOTALL),
        re.compile(r'"(?:\\.|[^"\\])*"'),
        re.compile(r"'[^']*'"),
    )

    def __init__(self, text: str) -> None:
        self.text = text.replace("\r\n", "\n")
        self.position = 0
        self.line_starts = [0, *(found.end() for found in re.finditer("\n", self.text))]
        self.lines: dict[KeyPath, int] = {}
        self.array_lengths: dict[KeyPath, int] = {}
        self._file()

    def _file(self) -> None:
        table: KeyPath = ()
        while self._skip(self.SPACE) and self.position < len(self.text):
            if self.text.startswith("[", self.position):
                table = self._header()
            else:
                self._key_and_value(table)

    def _header(self) -> KeyPath:
        line = self._line()
        is_array = self.text.startswith("[[", self.position)
        self.position += 2 if is_array else 1
        path = self._inside_arrays(self._dotted_key())
        self.position += 2 if is_array else 1
        self.lines.setdefault(path, line)
        if is_array:
            index = self.array_lengths.get(path, 0)
            self.array_lengths[path] = index + 1
            path = (*path, index)
            self.lines[path] = line
        return path

    def _inside_arrays(self, keys: KeyPath) -> KeyPath:
        """`[render.lights.x]` speaks of the last element of `[[render.lights]]`."""
        path: KeyPath = keys[:1]
        for key in keys[1:]:
            if path in self.array_lengths:
                path = (*path, self.array_lengths[path] - 1)
            path = (*path, key)
        return path

    def _key_and_value(self, table: KeyPath) -> None:
        line = self._line()
        path = table
        for key in self._dotted_key():
            path = (*path, key)
            self.lines.setdefault(path, line)
        self._expect("=")
        self._value(path)

    def _dotted_key(self) -> KeyPath:
        keys = [self._key()]
        while self._skip(self.BLANK) and self.text.startswith(".", self.position):
            self.position += 1
            keys.append(self._key())
            if len(keys) > MAX_DEPTH:  # noted one by one, the paths to a million dots would fill the memory
                raise RecursionError
        return tuple(keys)

    def _key(self) -> str:
        self._skip(self.BLANK)
        if self.text[self.position] in "\"'":
            literal = self._take(self.STRINGS[2 if self.text[self.position] == '"' else 3])
            return next(iter(tomllib.loads(f"{literal} = 0")))
        return self._take(self.BARE_KEY)

    def _value(self, path: KeyPath) -> None:
        self._skip(self.BLANK)
        first = self.text[self.position]
        if first == "[":
            self._array(path)
        elif first == "{":
            self._inline_table(path)
        elif first in "\"'":
            self._take(next(form for form in self.STRINGS if form.match(self.text, self.position)))
        else:
            self._take(self.SCALAR)

    def _array(self, path: KeyPath) -> None:
        self.position += 1
        index = 0
        while self._skip(self.SPACE) and self.text[self.position] != "]":
            if self.text[self.position] == ",":
                self.position += 1
                continue
            self.lines[(*path, index)] = self._line()
            self._value((*path, index))
            index += 1
        self.position += 1

    def _inline_table(self, path: KeyPath) -> None:
        self.position += 1
        while self._skip(self.SPACE) and self.text[self.position] != "}":
            if self.text[self.position] == ",":
                self.position += 1
                continue
            self._key_and_value(path)
        self.position += 1

    def _line(self) -> int:
        return bisect.bisect_right(self.line_starts, self.position)

    def _skip(self, pattern: re.Pattern[str]) -> bool:
        self._take(pattern)
        return True

    def _expect(self, character: str) -> None:
        self._skip(self.BLANK)
        assert self.text[self.position] == character
        self.position += 1

    def _take(self, pattern: re.Pattern[str]) -> str:
        found = pattern.match(self.text, self.position)
        assert found is not None
        self.position = found.end()
        return found[0]
