"""Speed of the phase functions on llvmpipe: samples per CPU second, and the fiber over isotropic scattering.

CPU seconds, because other work on the machine then changes little; on a GPU they mean nothing.
"""

from __future__ import annotations

import time

import numpy as np
import pytest

from tests.fiber_model.scattering.scattering_cases import CORNERS, preset
from tests.renderer.probe import probe
from tests.renderer.shaders.fiber_probes import random_keys
from weft.fiber_model.scattering.phase import fiber_phase_sample
from weft.renderer.scattering_block import pack_scattering, pack_tables, phase_constants

pytestmark = [pytest.mark.gl, pytest.mark.benchmark]

BOUNCES = 100
MEDIA = {name: preset(name) for name in ("reference", "khungurn2015_silk")} | CORNERS
CHAIN = f"""
layout(std430, binding = 3) readonly buffer Tables {{ vec4 fiber_table[]; }};
#include "phase/fiber.glsl"
#include "phase/isotropic.glsl"
layout(std430, binding = 2) readonly buffer Media {{ FiberScattering media[]; }};
vec3 fiber_chain(vec3 wo, uvec4 rng) {{
    vec3 weight;
    float pdf;
    for (int i = 0; i < {BOUNCES}; ++i) wo = -fiber_sample(media[0], wo, rng, weight, pdf) * weight;
    return wo;
}}
vec3 fiber_sum(vec3 wo, uvec4 rng) {{
    vec3 total = vec3(0.0);
    for (int i = 0; i < {BOUNCES}; ++i) {{
        vec3 wi = isotropic_sample(wo, random4(rng).xy);
        total += fiber_eval(media[0], wo, wi);
        wo = -wi;
    }}
    return total;
}}
vec3 isotropic_chain(vec3 wo, uvec4 rng) {{
    vec3 total = vec3(0.0);
    for (int i = 0; i < {BOUNCES}; ++i) {{
        wo = isotropic_sample(wo, random4(rng).xy);
        total += wo;
    }}
    return total;
}}
"""


def rate(parameters, function, items):
    """Million calls per CPU second, the best of three, without compiling."""
    tables = pack_tables([parameters])
    blocks = {2: pack_scattering([parameters]), 3: tables if len(tables) else np.zeros((1, 4), np.float32)}
    signature = f"vec3 {function}(vec3 wo, uvec4 rng)"
    call = probe(
        [],
        signature,
        prelude=CHAIN,
        blocks=blocks,
        constants={"RANDOM_KIND": 0} | phase_constants([parameters]),
    )
    wo, keys = np.array([0.6, 0.8, 0.0]), random_keys(items, seed=1)
    call(wo, keys[:64])
    seconds = []
    for _ in range(3):
        started = time.process_time()
        call(wo, keys)
        seconds.append(time.process_time() - started)
    return items * BOUNCES / min(seconds) / 1e6


def test_samples_per_second(capsys):
    with capsys.disabled():
        isotropic = rate(MEDIA["reference"], "isotropic_chain", 20_000)
        print(f"\nisotropic              sample {isotropic:7.1f} M per CPU s")
        for name, parameters in MEDIA.items():
            sample = rate(parameters, "fiber_chain", 20_000)
            value = rate(parameters, "fiber_sum", 20_000)
            print(
                f"{name:22s} sample {sample:7.1f} M per CPU s ({isotropic / sample:4.1f}x isotropic's time), "
                f"eval {value:7.1f} M per CPU s"
            )
        u, wo = np.random.default_rng(1).random((100_000, 4)), np.broadcast_to([0.6, 0.8, 0.0], (100_000, 3))
        started = time.process_time()
        fiber_phase_sample(MEDIA["reference"], wo, u)
        print(f"reference in numpy     sample {0.1 / (time.process_time() - started):7.1f} M per CPU s")
