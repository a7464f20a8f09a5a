"""Assembling shaders: pieces once, constants in one place, errors that name the file and line."""

from __future__ import annotations

import pytest

from weft.renderer.gpu import shader_source
from weft.renderer.gpu.context import shared_context
from weft.renderer.gpu.programs import compute_program
from weft.renderer.gpu.shader_source import ShaderSourceError, assemble, glsl_literal


@pytest.fixture
def shader_folder(tmp_path, monkeypatch):
    monkeypatch.setattr(shader_source, "SHADER_FOLDER", tmp_path)
    (tmp_path / "one.glsl").write_text("float one() { return 1.0; }\n")
    (tmp_path / "two.glsl").write_text('#include "one.glsl"\nfloat two() { return one() + one(); }\n')
    (tmp_path / "sized.glsl").write_text("#constant BRICK_SIZE\n")
    return tmp_path


def test_a_piece_is_included_once(shader_folder):
    text = assemble(
        "main.comp", '#version 430\n#include "two.glsl"\n#include "one.glsl"\n', constants={}
    ).text
    assert text.count("float one()") == 1
    assert text.startswith("#version 430")


def test_missing_include_is_an_error(shader_folder):
    with pytest.raises(ShaderSourceError, match=r"main.comp:2: no such shader: three.glsl"):
        assemble("main.comp", '#version 430\n#include "three.glsl"\n', constants={})


def test_missing_constant_is_an_error(shader_folder):
    with pytest.raises(ShaderSourceError, match=r"sized.glsl:1: no value was given for constant BRICK_SIZE"):
        assemble("main.comp", '#include "sized.glsl"\n', constants={})


def test_unknown_constant_is_an_error(shader_folder):
    with pytest.raises(ShaderSourceError, match=r"no shader asks for constant BRICK_SIZ$"):
        assemble("main.comp", '#include "sized.glsl"\n', constants={"BRICK_SIZE": 8, "BRICK_SIZ": 8})


@pytest.mark.parametrize(
    ("value", "literal"),
    [(True, "1"), (7, "7"), (2**31, "2147483648u"), (0.5, "0.5"), (-1e-9, "(-1e-09)"), (3.0, "3.0")],
)
def test_literals_are_typed(value, literal):
    assert glsl_literal(value) == literal


@pytest.mark.gl
def test_compile_error_names_file_and_line(shader_folder):
    (shader_folder / "broken.glsl").write_text(
        "float fine() { return 1.0; }\nfloat broken() { return nothing; }\n"
    )
    text = "#version 430\nlayout(local_size_x = 1) in;\n"
    text += '#include "one.glsl"\n#include "broken.glsl"\nvoid main() {}\n'
    with pytest.raises(ShaderSourceError, match=r"broken.glsl:2"):
        compute_program(shared_context(), "main.comp", text=text, constants={})
