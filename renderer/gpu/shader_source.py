"""Assembling GLSL: `#include "phase/fiber.glsl"`, `#constant NAME`, and line numbers for readable errors.

- `#include "path"`: relative to renderer/shaders/, each file at most once; a missing file is an error. Text
  made at run time (a struct, a choice between pieces) is included the same way, from `pieces`.
- `#constant NAME`: becomes `#define NAME value`; a constant without a value, or a value no shader asks for,
  is an error, so a typing mistake never turns into an empty string.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

SHADER_FOLDER = Path(__file__).resolve().parent.parent / "shaders"

Constant = bool | int | float

_INCLUDE = re.compile(r'^\s*#include\s+"([^"]+)"\s*(?://.*)?$')
_CONSTANT = re.compile(r"^\s*#constant\s+(\w+)\s*(?://.*)?$")
_MESA_PLACE = re.compile(r"^(\d+):(\d+)\((\d+)\)", re.MULTILINE)
_NVIDIA_PLACE = re.compile(r"^(\d+)\((\d+)\)", re.MULTILINE)


class ShaderSourceError(Exception):
    """A mistake in our own shaders: a missing piece, a missing or unknown constant."""


@dataclass
class ShaderSource:
    """Assembled text, and the names of the source strings its #line directives count."""

    text: str
    names: list[str]

    def readable(self, compiler_log: str) -> str:
        """The compiler's log with source numbers replaced by file names."""

        def place(match: re.Match[str]) -> str:
            number = int(match[1])
            name = self.names[number] if number < len(self.names) else match[1]
            return f"{name}:{match[2]}"

        return _NVIDIA_PLACE.sub(place, _MESA_PLACE.sub(place, compiler_log))


@dataclass
class _Assembler:
    constants: Mapping[str, Constant]
    pieces: Mapping[str, str]
    lines: list[str] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    included: set[str] = field(default_factory=set)
    defined: set[str] = field(default_factory=set)

    def add(self, name: str, text: str) -> None:
        number = len(self.names)
        self.names.append(name)
        if number:
            self.lines.append(f"#line 1 {number}")
        for line_number, line in enumerate(text.splitlines(), start=1):
            if include := _INCLUDE.match(line):
                self._include(include[1], f"{name}:{line_number}")
                self.lines.append(f"#line {line_number + 1} {number}")
            elif constant := _CONSTANT.match(line):
                self.lines.append(self._define(constant[1], f"{name}:{line_number}"))
            else:
                self.lines.append(line)

    def _include(self, path: str, place: str) -> None:
        if path in self.included:
            return
        self.included.add(path)
        self.add(path, self.pieces[path] if path in self.pieces else read_shader(path, place=place))

    def _define(self, name: str, place: str) -> str:
        if name not in self.constants:
            raise ShaderSourceError(f"{place}: no value was given for constant {name}")
        if name in self.defined:
            return ""
        self.defined.add(name)
        return f"#define {name} {glsl_literal(self.constants[name])}"


def read_shader(path: str, *, place: str = "") -> str:
    """Text of one file under renderer/shaders/."""
    file = SHADER_FOLDER / path
    if not file.is_file():
        raise ShaderSourceError(f"{place}: no such shader: {path}".removeprefix(": "))
    return file.read_text(encoding="utf-8")


def assemble(
    name: str,
    text: str | None = None,
    *,
    constants: Mapping[str, Constant],
    pieces: Mapping[str, str] | None = None,
) -> ShaderSource:
    """The shader `name` under renderer/shaders/ (or `text` under that name) with its pieces and constants."""
    assembler = _Assembler(constants, pieces or {})
    assembler.add(name, read_shader(name) if text is None else text)
    if unknown := sorted(set(constants) - assembler.defined):
        raise ShaderSourceError(f"{name}: no shader asks for constant {', '.join(unknown)}")
    return ShaderSource("\n".join(assembler.lines) + "\n", assembler.names)


def glsl_literal(value: Constant) -> str:
    """A typed GLSL literal: 1, 0.5, 1e-05."""
    if isinstance(value, bool):
        return str(int(value))
    if isinstance(value, int):
        return str(value) if value < 2**31 else f"{value}u"
    literal = repr(float(value))
    if literal in ("inf", "-inf", "nan"):
        raise ShaderSourceError(f"{literal} has no GLSL literal")
    return literal if value >= 0 else f"({literal})"
