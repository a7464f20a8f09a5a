"""One light path through one fiber, as a Warp kernel in float64: from the light to the far field.

The fiber is straight and along x; its outline is a chain of arcs. Light comes from azimuth psi, uniform, at a
uniform offset across a circle around the fiber, and is drawn again where it misses: that is light spread
evenly over the projected width of each rotation, and over rotations by the light that each of them catches.
Every path ends in one direction, with one weight per channel.
"""

# mypy: ignore-errors
# Warp reads the annotations, and some of them are calls.

from __future__ import annotations

import warp as wp

from weft.fiber_model.random_kernels import pcg4d

from .interface_kernels import (
    HALF,
    ONE,
    TWO,
    TWO_PI,
    ZERO,
    escape_probability,
    fresnel,
    reflect,
    refract,
    visible_normal,
)

wp.set_module_options({"enable_backward": False})

EDGE = wp.constant(wp.float64(1e-12))
"""Overlap of neighboring arcs, as a part of the bounding radius: no ray slips through a joint."""
FLOOR_EVENTS = wp.constant(2)
"""The reflection floor holds for so many meetings with the surface: those that make R and TRT."""
FAINT = wp.constant(wp.float64(0.02))
"""Weight in every channel below which Russian roulette begins. Bright light is followed to its end: playing
for it would let the weights of light that is guided along the fiber grow without bound."""
SURVIVAL = wp.constant(wp.float64(0.9))
MOST_EVENTS = wp.constant(100000)
"""Meetings with the surface after which a path counts as lost."""
START_TRIES = wp.constant(wp.uint32(256))

LOST = wp.constant(-1)
"""In place of the order: no way out was found."""
GONE = wp.constant(-2)
"""In place of the order: ended by Russian roulette."""


@wp.struct
class Arc:
    start: wp.vec2d
    tangent: wp.vec2d
    end: wp.vec2d
    end_tangent: wp.vec2d
    curvature: wp.float64
    middle: wp.vec2d
    """Of its chord: the circle over the chord holds the arc."""
    reach: wp.float64
    """Radius of that circle, and a little more."""


@wp.struct
class Fiber:
    arcs: wp.array(dtype=Arc)
    arc_count: wp.int32
    convex: wp.int32
    bounding_radius: wp.float64
    index: wp.float64
    alpha: wp.float64
    absorption: wp.vec3d
    reflection_floor: wp.float64


@wp.struct
class Hit:
    arc: wp.int32
    """-1: nothing was hit."""
    distance: wp.float64
    place: wp.vec2d
    normal: wp.vec2d
    """Outward."""


@wp.struct
class Light:
    """The state of a path."""

    direction: wp.vec3d
    local: wp.vec3d
    """The direction in the frame of interface_kernels.py, while the light is at the surface."""
    held: wp.bool
    """Whether the rough surface still holds it."""
    weight: wp.vec3d
    inside: wp.int32
    events: wp.int32
    draws: wp.uint32
    """How many times random numbers were drawn for it."""
    order: wp.int32


@wp.struct
class Arrival:
    hit: Hit
    azimuth: wp.float64
    """Of the light, around the fiber as it lies."""
    draws: wp.uint32


@wp.struct
class Key:
    seed: wp.uint32
    stream: wp.uint32
    path: wp.uint32


@wp.func
def uniform(word: wp.uint32) -> wp.float64:
    """Twin: `counter_random.uniform`."""
    return (wp.float64(word) + HALF) * wp.float64(2.3283064365386963e-10)


@wp.func
def draw(key: Key, counter: wp.uint32) -> wp.vec4d:
    word = pcg4d(key.path, counter, key.stream, key.seed)
    return wp.vec4d(uniform(word[0]), uniform(word[1]), uniform(word[2]), uniform(word[3]))


@wp.func
def arc_distance(
    arc: Arc, offset: wp.vec2d, along: wp.vec2d, sign: wp.float64, leaving: wp.bool
) -> wp.float64:
    """Distance along a ray to the root where it crosses the arc's circle or line in the right sense; or -1.

    With d = p - start and the left normal n: curvature d·d - 2 d·n = 0, outward normal curvature d - n.
    `sign` is 1 for rays that go out; `leaving` says that the ray starts on this very arc (one root is 0).
    """
    left = wp.vec2d(-arc.tangent[1], arc.tangent[0])
    a = arc.curvature
    b = a * wp.dot(offset, along) - wp.dot(along, left)
    distance = -ONE
    if leaving:
        if a * b < ZERO and b * sign < ZERO:
            distance = -TWO * b / a
    else:
        c = a * wp.dot(offset, offset) - TWO * wp.dot(offset, left)
        root = b * b - a * c
        if root > ZERO:
            # along · normal = a t + b = ± sqrt(root) at the roots: the sense of crossing picks one
            slope = sign * wp.sqrt(root)
            if b * slope >= ZERO:
                distance = -c / (slope + b)
            elif a != ZERO:
                distance = (slope - b) / a
    return distance


@wp.func
def nearest_hit(fiber: Fiber, origin: wp.vec2d, along: wp.vec2d, inside: wp.int32, last: wp.int32) -> Hit:
    """The first arc that the ray from `origin` (on arc `last`, or -1) along a unit vector meets."""
    hit = Hit()
    hit.arc = -1
    hit.distance = wp.float64(1e300)
    sign = ONE if inside == 1 else -ONE
    reach = EDGE * fiber.bounding_radius
    for i in range(fiber.arc_count):
        arc = fiber.arcs[i]
        aside = arc.middle - origin
        if wp.abs(along[0] * aside[1] - along[1] * aside[0]) > arc.reach:
            continue
        offset = origin - arc.start
        distance = arc_distance(arc, offset, along, sign, i == last)
        if distance > ZERO and distance < hit.distance:
            from_start = offset + distance * along
            from_end = origin + distance * along - arc.end
            if wp.dot(from_start, arc.tangent) >= -reach and wp.dot(from_end, arc.end_tangent) <= reach:
                hit.arc = i
                hit.distance = distance
                hit.place = from_start + arc.start
                hit.normal = arc.curvature * from_start - wp.vec2d(-arc.tangent[1], arc.tangent[0])
    return hit


@wp.func
def meet_facet(fiber: Fiber, key: Key, light: Light) -> Light:
    """One meeting with the surface: reflect or refract `light.local`, and say whether it is held."""
    eta = fiber.index if light.inside == 0 else ONE / fiber.index
    u = draw(key, light.draws)
    choice = draw(key, light.draws + wp.uint32(1))
    light.draws = light.draws + wp.uint32(2)
    light.events += 1
    view = -light.local
    facet = wp.vec3d(ZERO, ZERO, ONE)
    if fiber.alpha > ZERO:
        facet = visible_normal(view, fiber.alpha, u[0], u[1])
    reflectance = fresnel(wp.max(wp.dot(view, facet), ZERO), eta)
    chance = reflectance
    if light.events <= FLOOR_EVENTS:
        chance = wp.max(reflectance, fiber.reflection_floor)
    if choice[0] < chance:
        light.local = reflect(view, facet)
        light.weight = light.weight * (reflectance / chance)
    else:
        refracted = refract(view, facet, eta)
        light.local = wp.vec3d(refracted[0], refracted[1], -refracted[2])
        light.weight = light.weight * ((ONE - reflectance) / (ONE - chance))
        light.inside = 1 - light.inside
    light.held = wp.bool(False)
    if fiber.alpha > ZERO:
        light.held = choice[1] >= escape_probability(light.local, fiber.alpha)
        light.local = wp.normalize(light.local)
    if wp.max(light.weight) < FAINT:
        if choice[2] < SURVIVAL:
            light.weight = light.weight / SURVIVAL
        else:
            light.weight = wp.vec3d(ZERO, ZERO, ZERO)
    if light.events >= MOST_EVENTS or wp.max(light.weight) <= ZERO:
        light.held = wp.bool(False)
    return light


@wp.func
def cross_surface(fiber: Fiber, key: Key, light: Light, normal: wp.vec2d) -> Light:
    """Follow the light at one place of the surface until it leaves it, outward or inward."""
    side = -ONE if light.inside == 1 else ONE
    light.local = wp.vec3d(
        light.direction[0],
        light.direction[2] * normal[0] - light.direction[1] * normal[1],
        side * (light.direction[1] * normal[0] + light.direction[2] * normal[1]),
    )
    light.held = wp.bool(True)
    while light.held:
        light = meet_facet(fiber, key, light)
    side = -ONE if light.inside == 1 else ONE
    across = side * light.local[2]
    light.direction = wp.vec3d(
        light.local[0],
        across * normal[0] - light.local[1] * normal[1],
        across * normal[1] + light.local[1] * normal[0],
    )
    return light


@wp.func
def arrive(fiber: Fiber, key: Key) -> Arrival:
    """Where light from a random side first meets the fiber; no place after `START_TRIES` misses."""
    arrival = Arrival()
    arrival.draws = wp.uint32(0)
    hit = Hit()
    hit.arc = -1
    while hit.arc < 0 and arrival.draws < START_TRIES:
        u = draw(key, arrival.draws)
        arrival.draws = arrival.draws + wp.uint32(1)
        arrival.azimuth = TWO_PI * u[0]
        toward = wp.vec2d(wp.cos(arrival.azimuth), wp.sin(arrival.azimuth))
        offset = (TWO * u[1] - ONE) * fiber.bounding_radius
        away = TWO * fiber.bounding_radius
        start = wp.vec2d(away * toward[0] - offset * toward[1], away * toward[1] + offset * toward[0])
        hit = nearest_hit(fiber, start, -toward, 0, -1)
    arrival.hit = hit
    return arrival


@wp.func
def absorb(fiber: Fiber, weight: wp.vec3d, length: wp.float64) -> wp.vec3d:
    """Beer and Lambert over the length in space [mm]."""
    return wp.vec3d(
        weight[0] * wp.exp(-fiber.absorption[0] * length),
        weight[1] * wp.exp(-fiber.absorption[1] * length),
        weight[2] * wp.exp(-fiber.absorption[2] * length),
    )


@wp.func
def follow(fiber: Fiber, key: Key, start: Hit, light: Light) -> Light:
    """From where the light meets the fiber to where it leaves it for good, or ends."""
    hit = start
    chords = wp.int32(0)
    returns = wp.int32(0)
    light.order = LOST
    running = wp.bool(True)
    while running:
        light = cross_surface(fiber, key, light, hit.normal)
        flat = wp.vec2d(light.direction[1], light.direction[2])
        extent = wp.length(flat)
        running = wp.bool(False)
        if wp.max(light.weight) <= ZERO:
            light.order = GONE
        elif light.events >= MOST_EVENTS:
            light.order = LOST
        elif light.inside == 1:
            hit = nearest_hit(fiber, hit.place, flat / extent, 1, hit.arc)
            running = hit.arc >= 0
            chords += 1
            light.weight = absorb(fiber, light.weight, hit.distance / extent)
        else:
            if fiber.convex == 0:
                hit = nearest_hit(fiber, hit.place, flat / extent, 0, hit.arc)
                running = hit.arc >= 0
            if running:
                returns += 1
            else:
                light.order = wp.min(chords, 3) if returns == 0 else 3
    return light


@wp.kernel
def trace_paths(
    fiber: Fiber,
    theta_i: wp.float64,
    seed: wp.uint32,
    stream: wp.uint32,
    first: wp.uint32,
    sin_theta_o: wp.array(dtype=wp.float64),
    phi_o: wp.array(dtype=wp.float64),
    weight: wp.array(dtype=wp.vec3d),
    order: wp.array(dtype=wp.int32),
):
    """Path `first` + thread: where it ends (phi relative to the light), its weights and its order.

    Order: times that the light went through the inside, 0 for R to 2 for TRT; 3 for more, and for light that
    met the fiber again from outside.
    """
    thread = wp.tid()
    key = Key()
    key.seed = seed
    key.stream = stream
    key.path = first + wp.uint32(thread)
    arrival = arrive(fiber, key)
    cosine = wp.cos(theta_i)
    light = Light()
    light.direction = wp.vec3d(
        -wp.sin(theta_i), -cosine * wp.cos(arrival.azimuth), -cosine * wp.sin(arrival.azimuth)
    )
    light.weight = wp.vec3d(ONE, ONE, ONE)
    light.inside = 0
    light.events = 0
    light.draws = arrival.draws
    light.order = LOST
    if arrival.hit.arc >= 0:
        light = follow(fiber, key, arrival.hit, light)
    azimuth = wp.atan2(light.direction[2], light.direction[1]) - arrival.azimuth
    sin_theta_o[thread] = light.direction[0]
    phi_o[thread] = azimuth - TWO_PI * wp.floor(azimuth / TWO_PI + HALF)
    weight[thread] = light.weight
    order[thread] = light.order
