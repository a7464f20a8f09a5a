"""Call one GLSL function from Python, over arrays of arguments, through a generated compute shader.

    hg_eval = probe("phase/henyey_greenstein.glsl", "float henyey_greenstein_eval(vec3 wo, vec3 wi, float g)")
    values = hg_eval(wo, wi, 0.7)        # wo: [..., 3], wi: [..., 3], g: [...]; all broadcast together

`in` parameters are arguments; `out` and `inout` ones follow the return value, in order, in a tuple.
Types: bool, int, uint, float and their vectors of 2 to 4; mat3 is [..., column, row], as GLSL indexes it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from weft.renderer.gpu import buffers
from weft.renderer.gpu.context import shared_context
from weft.renderer.gpu.programs import compute_program
from weft.renderer.gpu.shader_source import Constant

GROUP_SIZE = 64
ITEMS_PER_DISPATCH = 1 << 20

_SIGNATURE = re.compile(r"^\s*(\w+)\s+(\w+)\s*\((.*)\)\s*;?\s*$", re.DOTALL)
_SCALARS = {"float": np.float32, "int": np.int32, "uint": np.uint32, "bool": np.uint32}
_VECTORS = {"vec": "float", "ivec": "int", "uvec": "uint", "bvec": "bool"}
_TO_WORD = {
    "float": "floatBitsToUint({})",
    "int": "uint({})",
    "uint": "{}",
    "bool": "uint({})",
}
_FROM_WORD = {"float": "uintBitsToFloat({})", "int": "int({})", "uint": "{}", "bool": "({} != 0u)"}


@dataclass(frozen=True)
class _Parameter:
    qualifier: str
    type: str
    name: str

    @property
    def scalar(self) -> str:
        if self.type == "mat3":
            return "float"
        return self.type if self.type in _SCALARS else _VECTORS[self.type[:-1]]

    @property
    def shape(self) -> tuple[int, ...]:
        if self.type == "mat3":
            return (3, 3)
        return () if self.type in _SCALARS else (int(self.type[-1]),)

    @property
    def size(self) -> int:
        return int(np.prod(self.shape, dtype=int))

    def unpack(self, word: str, start: int) -> str:
        words = [_FROM_WORD[self.scalar].format(f"{word}[{start + i} + base]") for i in range(self.size)]
        return f"{self.type}({', '.join(words)})"

    def pack(self, value: str) -> list[str]:
        if self.type == "mat3":
            return [f"floatBitsToUint({value}[{i // 3}][{i % 3}])" for i in range(9)]
        parts = [f"{value}[{i}]" for i in range(self.size)] if self.shape else [value]
        return [_TO_WORD[self.scalar].format(part) for part in parts]


def probe(
    path: str | Sequence[str],
    signature: str,
    *,
    constants: Mapping[str, Constant] | None = None,
    prelude: str = "",
    blocks: Mapping[int, np.ndarray] | None = None,
    uniforms: Mapping[str, Any] | None = None,
) -> Callable[..., Any]:
    """A vectorized Python callable running the GLSL function `signature` of the piece(s) `path`.

    prelude: GLSL placed before the pieces (bindings 0 and 1 are taken). blocks: storage buffers by binding.
    The shader is compiled at the first call, so a test module can be collected without OpenGL.
    """
    paths = [path] if isinstance(path, str) else list(path)
    return _Probe(paths, signature, dict(constants or {}), prelude, dict(blocks or {}), dict(uniforms or {}))


class _Probe:
    def __init__(
        self,
        paths: list[str],
        signature: str,
        constants: dict[str, Constant],
        prelude: str,
        blocks: dict[int, np.ndarray],
        uniforms: dict[str, Any],
    ) -> None:
        match = _SIGNATURE.match(signature)
        if match is None:
            raise ValueError(f"not a GLSL function signature: {signature}")
        self.result, self.name = _Parameter("out", match[1], "result"), match[2]
        self.parameters = [_parse_parameter(text) for text in match[3].split(",") if text.strip()]
        self.inputs = [p for p in self.parameters if p.qualifier in ("in", "inout")]
        self.outputs = [p for p in self.parameters if p.qualifier in ("out", "inout")]
        if self.result.type != "void":
            self.outputs.insert(0, self.result)
        self.text = _program_text(paths, prelude, self)
        self.constants, self.blocks, self.uniforms = constants, blocks, uniforms
        self.program: Any = None

    def __call__(self, *arguments: Any) -> Any:
        if len(arguments) != len(self.inputs):
            raise TypeError(f"{self.name} takes {len(self.inputs)} arguments, got {len(arguments)}")
        arrays = [
            np.asarray(a, dtype=_SCALARS[p.scalar]) for a, p in zip(arguments, self.inputs, strict=True)
        ]
        leading = [a.shape[: a.ndim - len(p.shape)] for a, p in zip(arrays, self.inputs, strict=True)]
        shape = np.broadcast_shapes(*leading) if leading else ()
        words = [
            np.broadcast_to(a, shape + p.shape).reshape(-1, p.size).view(np.uint32)
            for a, p in zip(map(np.ascontiguousarray, arrays), self.inputs, strict=True)
        ]
        count = int(np.prod(shape, dtype=int))
        packed = np.concatenate(words, axis=1) if words else np.zeros((count, 1), np.uint32)
        chunks = [
            self._run(packed[start : start + ITEMS_PER_DISPATCH])
            for start in range(0, count, ITEMS_PER_DISPATCH)
        ]
        return self._unpack(np.concatenate(chunks), shape)

    def _run(self, packed: np.ndarray) -> np.ndarray:
        context = shared_context()
        if self.program is None:
            self.program = compute_program(
                context, f"probe of {self.name}", constants=self.constants, text=self.text
            )
        width = sum(p.size for p in self.outputs)
        source = buffers.upload(context, packed, name="arguments of a probe")
        target = buffers.reserve(context, len(packed) * width * 4, name="results of a probe")
        extra = {b: buffers.upload(context, data, name=f"block {b}") for b, data in self.blocks.items()}
        source.bind_to_storage_buffer(0)
        target.bind_to_storage_buffer(1)
        for binding, buffer in extra.items():
            buffer.bind_to_storage_buffer(binding)
        for name, value in self.uniforms.items():
            self.program[name] = value
        self.program["probe_item_count"] = len(packed)
        self.program.run(-(-len(packed) // GROUP_SIZE))
        context.finish()
        result = buffers.read(target, np.uint32).reshape(-1, width)
        for buffer in (source, target, *extra.values()):
            buffer.release()
        return result

    def _unpack(self, words: np.ndarray, shape: tuple[int, ...]) -> Any:
        results, start = [], 0
        for parameter in self.outputs:
            column = np.ascontiguousarray(words[:, start : start + parameter.size])
            start += parameter.size
            values = column.view(_SCALARS[parameter.scalar]).reshape(shape + parameter.shape)
            results.append(values.astype(bool) if parameter.scalar == "bool" else values)
        return results[0] if len(results) == 1 else tuple(results)


def _parse_parameter(text: str) -> _Parameter:
    words = text.split()
    qualifier = words.pop(0) if words[0] in ("in", "out", "inout") else "in"
    return _Parameter(qualifier, words[0], words[1])


def _program_text(paths: list[str], prelude: str, call: _Probe) -> str:
    includes = "\n".join(f'#include "{path}"' for path in paths)
    body, start = [], 0
    for p in call.parameters:
        if p.qualifier == "out":
            body.append(f"{p.type} {p.name}_;")
            continue
        body.append(f"{p.type} {p.name}_ = {p.unpack('probe_argument', start)};")
        start += p.size
    names = ", ".join(f"{p.name}_" for p in call.parameters)
    returned = "" if call.result.type == "void" else f"{call.result.type} result_ = "
    body.append(f"{returned}{call.name}({names});")
    words = [word for p in call.outputs for word in p.pack(f"{p.name}_")]
    body += [f"probe_result[item * {len(words)}u + {i}u] = {word};" for i, word in enumerate(words)]
    return f"""#version 430
layout(local_size_x = {GROUP_SIZE}) in;
layout(std430, binding = 0) readonly buffer ProbeArguments {{ uint probe_argument[]; }};
layout(std430, binding = 1) writeonly buffer ProbeResults {{ uint probe_result[]; }};
uniform int probe_item_count;
{prelude}
{includes}
void main() {{
    uint item = gl_GlobalInvocationID.x;
    if (item >= uint(probe_item_count)) return;
    uint base = item * {max(start, 1)}u;
    {chr(10).join(body)}
}}
"""
