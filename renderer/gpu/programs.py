"""Compute programs from assembled shaders."""

from __future__ import annotations

from collections.abc import Mapping

import moderngl

from .shader_source import Constant, ShaderSource, ShaderSourceError, assemble


def compute_program(
    context: moderngl.Context,
    name: str,
    *,
    constants: Mapping[str, Constant],
    pieces: Mapping[str, str] | None = None,
    text: str | None = None,
) -> moderngl.ComputeShader:
    """Compile renderer/shaders/`name` (or `text`); errors name the file and line of the piece they are in."""
    return compile_source(context, assemble(name, text, constants=constants, pieces=pieces))


def compile_source(context: moderngl.Context, source: ShaderSource) -> moderngl.ComputeShader:
    """Compile assembled text."""
    try:
        return context.compute_shader(source.text)
    except moderngl.Error as error:
        raise ShaderSourceError(source.readable(str(error))) from error


def set_uniforms(program: moderngl.ComputeShader, values: Mapping[str, object]) -> None:
    """Set uniforms by name, skipping those the compiler removed as unused."""
    for name, value in values.items():
        if name in program:
            program[name] = value
