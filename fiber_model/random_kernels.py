"""Random numbers as a function of what they are for, as Warp functions. Twin: `counter_random`."""

# mypy: ignore-errors
# Warp reads the annotations, and some of them are calls.

from __future__ import annotations

import warp as wp

wp.set_module_options({"enable_backward": False})

TWO_PI = wp.constant(wp.float32(6.283185307179586))


@wp.func
def pcg4d_mix(v: wp.vec4ui) -> wp.vec4ui:
    a = v[0] + v[1] * v[3]
    b = v[1] + v[2] * a
    c = v[2] + a * b
    d = v[3] + b * c
    return wp.vec4ui(a, b, c, d)


@wp.func
def pcg4d(x: wp.uint32, y: wp.uint32, z: wp.uint32, w: wp.uint32) -> wp.vec4ui:
    """Jarzynski and Olano 2020. Twin: `counter_random.pcg4d`."""
    multiplier = wp.uint32(1664525)
    increment = wp.uint32(1013904223)
    shift = wp.uint32(16)
    v = pcg4d_mix(
        wp.vec4ui(
            x * multiplier + increment,
            y * multiplier + increment,
            z * multiplier + increment,
            w * multiplier + increment,
        )
    )
    return pcg4d_mix(
        wp.vec4ui(
            v[0] ^ (v[0] >> shift), v[1] ^ (v[1] >> shift), v[2] ^ (v[2] >> shift), v[3] ^ (v[3] >> shift)
        )
    )


@wp.func
def uniform(word: wp.uint32) -> wp.float32:
    return (wp.float32(word >> wp.uint32(9)) + 0.5) * 1.1920928955078125e-07


@wp.func
def normal_pair(word_radius: wp.uint32, word_angle: wp.uint32) -> wp.vec2:
    radius = wp.sqrt(-2.0 * wp.log(uniform(word_radius)))
    angle = TWO_PI * uniform(word_angle)
    return wp.vec2(radius * wp.cos(angle), radius * wp.sin(angle))
