"""Hairs that wander or hang down, as Warp functions. Twins: `free_hairs`."""

# mypy: ignore-errors
# Warp reads the annotations, and some of them are calls.

from __future__ import annotations

import warp as wp

from . import counter_random, free_hairs
from .random_kernels import TWO_PI, normal_pair, pcg4d, uniform

wp.set_module_options({"enable_backward": False})

REDRAWS = wp.constant(counter_random.REDRAWS)
PURPOSE_WALK_STEP = wp.constant(wp.uint32(counter_random.PURPOSE_WALK_STEP))
STEEPEST = wp.constant(wp.float32(free_hairs.STEEPEST))


@wp.func
def uniform_direction(word_height: wp.uint32, word_around: wp.uint32) -> wp.vec3:
    """Uniform on the sphere."""
    height = 2.0 * uniform(word_height) - 1.0
    around = TWO_PI * uniform(word_around)
    across = wp.sqrt(wp.max(1.0 - height * height, 0.0))
    return wp.vec3(across * wp.cos(around), across * wp.sin(around), height)


@wp.func
def leaving_direction(outward: wp.vec3, toward: wp.vec3) -> wp.vec3:
    """Twin: `free_hairs.leaving_direction`."""
    total = outward + toward
    size = wp.length(total)
    if size <= 1.0e-4:
        return outward
    return total / size


@wp.func
def free_hair_length(
    purpose: wp.uint32, yarn: wp.uint32, stretch: wp.uint32, hair: wp.uint32, length: wp.vec2
) -> wp.float32:
    """A normal drawn until it is above 0."""
    for draw in range(REDRAWS):
        word = pcg4d(purpose + wp.uint32(2) + wp.uint32(draw), yarn, stretch, hair)
        normal = normal_pair(word[2], word[3])
        drawn = length[0] + length[1] * normal[0]
        if drawn > 0.0:
            return drawn
    return wp.float32(0.0)


@wp.func
def one_across(direction: wp.vec3) -> wp.vec3:
    """A unit vector across, from the coordinate axis y, or x where that is near."""
    axis = wp.vec3(0.0, 1.0, 0.0)
    if wp.abs(direction[1]) >= 0.8:
        axis = wp.vec3(1.0, 0.0, 0.0)
    return wp.normalize(wp.cross(axis, direction))


@wp.func
def turned(direction: wp.vec3, power: wp.float32, words: wp.vec4ui) -> wp.vec3:
    """The direction after one turn of a walk."""
    cosine = 2.0 * wp.pow(uniform(words[0]), power) - 1.0
    around = TWO_PI * uniform(words[1])
    first = one_across(direction)
    second = wp.cross(direction, first)
    sine = wp.sqrt(wp.max(1.0 - cosine * cosine, 0.0))
    return wp.normalize(direction * cosine + (first * wp.cos(around) + second * wp.sin(around)) * sine)


@wp.func
def walk_point(
    seed: wp.uint32,
    yarn: wp.uint32,
    stretch: wp.uint32,
    hair: wp.uint32,
    root: wp.vec3,
    direction: wp.vec3,
    step: wp.float32,
    persistence: wp.float32,
    k: wp.int32,
) -> wp.vec3:
    """Point `k` of a walk; all steps before it are walked again. Twin: `free_hairs.walk_points`."""
    power = wp.tanh(0.5 * step / persistence)
    point = root
    for j in range(k):
        point += direction * step
        event = hair * wp.uint32(256) + wp.uint32(j)
        direction = turned(direction, power, pcg4d(seed + PURPOSE_WALK_STEP, yarn, stretch, event))
    return point


@wp.func
def droop_point(root: wp.vec3, direction: wp.vec3, s: wp.float32, bend: wp.float32, down: wp.vec3) -> wp.vec3:
    """The point at arc length `s` of a drooping hair. Twin: `free_hairs.droop_points`."""
    along = wp.dot(direction, down)
    cosine = wp.max(along, STEEPEST - 1.0)
    sideways = direction - down * along
    size = wp.length(sideways)
    # straight up, any way to fall will do
    sideways = wp.where(size > 1.0e-4, sideways / size, one_across(down))
    begin = wp.sqrt(wp.max(1.0 - cosine, 0.0) / (1.0 + cosine))
    now = begin * wp.exp(-s / bend)
    fallen = s + bend * wp.log((1.0 + now * now) / (1.0 + begin * begin))
    gone = 2.0 * bend * (wp.atan(begin) - wp.atan(now))
    return root + down * fallen + sideways * gone
