"""The fiber's phase function on the device, callable from tests for a list of media."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from tests.renderer.probe import probe
from weft.fiber_model.scattering.parameters import FiberScatteringParameters
from weft.renderer.scattering_block import pack_scattering, pack_tables, phase_constants

_CALLS = """
layout(std430, binding = 3) readonly buffer Tables { vec4 fiber_table[]; };
#include "phase/fiber.glsl"
layout(std430, binding = 2) readonly buffer Media { FiberScattering media[]; };
vec3 evaluate(int medium, vec3 wo, vec3 wi) { return fiber_eval(media[medium], wo, wi); }
float density(int medium, vec3 wo, vec3 wi) { return fiber_pdf(media[medium], wo, wi); }
vec3 albedo(int medium, vec3 wo) { return fiber_albedo(media[medium], wo); }
vec3 draw(int medium, vec3 wo, inout uvec4 rng, out vec3 weight, out float pdf) {
    return fiber_sample(media[medium], wo, rng, weight, pdf);
}
vec3 scale(int medium, float theta_o) {
    return fiber_longitudinal_scale(media[medium], sin(theta_o), cos(theta_o));
}
"""


def fiber_probe(
    media: Sequence[FiberScatteringParameters], signature: str, *, philox: bool = False
) -> Callable:
    tables = pack_tables(media)
    blocks = {2: pack_scattering(media), 3: tables if len(tables) else np.zeros((1, 4), np.float32)}
    constants = {"RANDOM_KIND": int(philox)} | phase_constants(media)
    return probe([], signature, prelude=_CALLS, blocks=blocks, constants=constants)


def draw_probe(media: Sequence[FiberScatteringParameters], *, philox: bool = False) -> Callable:
    """draw(medium, wo, rng) -> wi, rng, weight, pdf."""
    return fiber_probe(
        media,
        "vec3 draw(int medium, vec3 wo, inout uvec4 rng, out vec3 weight, out float pdf)",
        philox=philox,
    )


def random_keys(count: int, *, seed: int, dimension: int = 0) -> np.ndarray:
    """Keys (pixel, sample, dimension, seed), shape [count, 4]."""
    keys = np.zeros((count, 4), np.uint32)
    keys[:, 0] = np.arange(count)
    keys[:, 2], keys[:, 3] = dimension, seed
    return keys
