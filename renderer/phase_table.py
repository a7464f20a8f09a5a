"""The phase functions of all media as the shaders read them: fibers, simple ones, or both in one picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from weft.fiber_model.scattering.parameters import FiberScatteringParameters
from weft.files.errors import InputError

from .gpu.shader_source import Constant
from .scattering_block import pack_scattering, pack_tables, phase_constants
from .simple_phases import SimplePhase, flake_roughness, pack_simple, simple_constants

__all__ = ["PhaseTable", "Scattering", "build_phase_table"]

Scattering = FiberScatteringParameters | SimplePhase


@dataclass(frozen=True)
class PhaseTable:
    """The phase function of all media: its GLSL pieces and their parameters."""

    piece: str
    block: str
    parameters: np.ndarray
    constants: Mapping[str, Constant]
    flake_roughness: float = 0.0
    """Of SGGX media, which changes their extinction; 0: fibers."""


def build_phase_table(
    media: tuple[str, ...], scattering: Mapping[str, Scattering], others: Sequence[SimplePhase] = ()
) -> PhaseTable:
    """Scattering of the media in their order; one set serves all where only one is given.

    `others`: of media that are none of the volume's, which come behind them.
    """
    if len(scattering) == 1 and len(media) >= 1:
        chosen = list(scattering.values()) * len(media)
    elif missing := [name for name in media if name not in scattering]:
        given = ", ".join(scattering) or "none"
        raise InputError(f"render: no scattering for medium {', '.join(missing)}; given are {given}.")
    else:
        chosen = [scattering[name] for name in media]
    fibers = [one for one in chosen if isinstance(one, FiberScatteringParameters)]
    simple = [one for one in chosen if not isinstance(one, FiberScatteringParameters)]
    if simple and fibers:
        raise InputError("render: a volume's media must all be fibers, or none of them.")
    if fibers:
        return _mixed_phase_table(fibers, others) if others else _fiber_phase_table(fibers)
    roughness = flake_roughness(simple)
    every = [*simple, *others]
    block = _block("vec4")
    return PhaseTable("path/phase_simple.glsl", block, pack_simple(every), simple_constants(every), roughness)


def _fiber_phase_table(fibers: list[FiberScatteringParameters]) -> PhaseTable:
    """The media, then their tables: in one buffer, since OpenGL 4.3 promises eight."""
    tables = pack_tables(fibers)
    constants = {"MEDIUM_COUNT": len(fibers)} | phase_constants(fibers)
    block = (
        '#include "phase/fiber_block.glsl"\n#constant MEDIUM_COUNT\n'
        "layout(std430, binding = 6) readonly buffer PhaseMedia {\n"
        "    FiberScattering phase_media[MEDIUM_COUNT];\n    vec4 fiber_table[];\n};\n"
    )
    packed = np.concatenate([pack_scattering(fibers).ravel(), tables.ravel()])
    return PhaseTable("path/phase_fiber.glsl", block, packed, constants)


def _mixed_phase_table(fibers: list[FiberScatteringParameters], others: Sequence[SimplePhase]) -> PhaseTable:
    """Fibers for every medium (any for the others), and behind their tables simple rows for every medium."""
    filled = _fiber_phase_table([*fibers, *(fibers[0] for _ in others)])
    table_rows = len(pack_tables([*fibers, *(fibers[0] for _ in others)]))
    no_rows = np.array([[0, 0, 0, -1], [0, 0, 0, 0]] * len(fibers), np.float32)
    rows = np.concatenate([no_rows, pack_simple(others)])
    return PhaseTable(
        "path/phase_mixed.glsl",
        filled.block,
        np.concatenate([filled.parameters, rows.ravel()]),
        {**filled.constants, **simple_constants(others), "SIMPLE_ROW": table_rows},
    )


def _block(struct: str) -> str:
    return f"layout(std430, binding = 6) readonly buffer PhaseMedia {{ {struct} phase_media[]; }};\n"
