"""Hairs as Warp functions: arcs (equation 11) here, those that wander or hang down with free_hair_kernels.py.

Twins: `flyaways.sample_hairs`, `free_hairs.sample_free_hairs`.
"""

# mypy: ignore-errors
# Warp reads the annotations, and some of them are calls.

from __future__ import annotations

import warp as wp

from . import counter_random, free_hairs
from .body_kernels import Strand, angle_of_one_in, place_between_nodes
from .fiber_tables import FiberTables, Stretch, YarnParameters
from .free_hair_kernels import droop_point, free_hair_length, leaving_direction, uniform_direction, walk_point
from .random_kernels import TWO_PI, normal_pair, pcg4d, uniform

wp.set_module_options({"enable_backward": False})

REDRAWS = wp.constant(counter_random.REDRAWS)
PURPOSE_HAIR_PLACE = wp.constant(wp.uint32(counter_random.PURPOSE_HAIR_PLACE))
PURPOSE_HAIR_SHAPE = wp.constant(wp.uint32(counter_random.PURPOSE_HAIR_SHAPE))
PURPOSE_WALK = wp.constant(wp.uint32(counter_random.PURPOSE_WALK))
PURPOSE_DROOP = wp.constant(wp.uint32(counter_random.PURPOSE_DROOP))
FREE_ROOT = wp.constant(wp.float32(free_hairs.ROOT))
ARC_HAIR = wp.constant(1)
WALK_HAIR = wp.constant(2)
DROOP_HAIR = wp.constant(3)


@wp.func
def hair_point(tables: FiberTables, strand: Strand, k: wp.int32) -> wp.vec3:
    """Point `k` of a hair: an arc (equation 11), a walk or a droop."""
    if strand.is_hair == ARC_HAIR:
        return arc_point(tables, strand, k)
    shape = tables.free_hairs[strand.yarn]
    if strand.is_hair == DROOP_HAIR:
        s = strand.length * wp.float32(k) / wp.float32(strand.segments)
        return droop_point(strand.root, strand.direction, s, shape.bend, shape.down)
    return walk_point(
        tables.seed,
        wp.uint32(strand.yarn),
        wp.uint32(strand.stretch),
        wp.uint32(strand.hair),
        strand.root,
        strand.direction,
        strand.length / wp.float32(strand.segments),
        shape.persistence,
        k,
    )


@wp.func
def arc_point(tables: FiberTables, strand: Strand, k: wp.int32) -> wp.vec3:
    """Point `k` of a hair of equation 11."""
    yarn = tables.yarns[strand.yarn]
    t = strand.extent * wp.float32(k) / wp.float32(strand.segments)
    along = strand.start + strand.run * t
    whole = wp.floor(along)
    index = strand.first + wp.int32(whole)
    if yarn.closed != 0:
        index = index % yarn.intervals
        if index < 0:
            index = index + yarn.intervals
    else:
        index = wp.clamp(index, 0, yarn.intervals - 1)
        whole = wp.float32(index - strand.first)
    angle = strand.angle + strand.angle_span * t
    radius = strand.radius + strand.radius_span * t
    part = wp.vec2(wp.cos(angle), wp.sin(angle)) * radius
    return place_between_nodes(tables, strand, yarn.first_node + index, along - whole, part)


@wp.func
def open_hair(tables: FiberTables, stretch: Stretch, hair: wp.int32) -> Strand:
    """Draw the shape of a hair; those of equation 11 come first, then walks, then droops."""
    arcs = stretch.hairs - stretch.walks - stretch.droops
    if hair < arcs:
        return open_arc(tables, stretch, hair)
    if hair < arcs + stretch.walks:
        return open_free_hair(tables, stretch, hair - arcs, WALK_HAIR)
    return open_free_hair(tables, stretch, hair - arcs - stretch.walks, DROOP_HAIR)


@wp.func
def open_free_hair(tables: FiberTables, stretch: Stretch, hair: wp.int32, kind: wp.int32) -> Strand:
    """Draw a walk or a droop. Twin: `free_hairs.sample_free_hairs`."""
    yarn = tables.yarns[stretch.yarn]
    purpose = tables.seed + PURPOSE_WALK
    length = tables.free_hairs[stretch.yarn].walk_length
    if kind == DROOP_HAIR:
        purpose = tables.seed + PURPOSE_DROOP
        length = tables.free_hairs[stretch.yarn].droop_length
    y = wp.uint32(stretch.yarn)
    z = wp.uint32(stretch.number)
    w = wp.uint32(hair)
    place = pcg4d(purpose, y, z, w)
    words = pcg4d(purpose + wp.uint32(1), y, z, w)
    strand = Strand()
    strand.is_hair = kind
    strand.yarn = stretch.yarn
    strand.stretch = stretch.number
    strand.hair = hair
    strand.segments = tables.hair_segments
    strand.first = stretch.first
    ply = wp.min(wp.int32(uniform(place[2]) * wp.float32(yarn.plies)), yarn.plies - 1)
    strand.fiber = ply * yarn.fibers_per_ply
    strand.ply = angle_of_one_in(ply % yarn.plies_per_cord, yarn.plies_per_cord)
    strand.cord = angle_of_one_in(ply // yarn.plies_per_cord, yarn.cords)
    strand.start = uniform(place[0]) * wp.float32(stretch.segments)
    along = wp.min(wp.int32(strand.start), stretch.segments - 1)
    first = yarn.first_node + stretch.first + along
    t = strand.start - wp.float32(along)
    angle = TWO_PI * uniform(place[1])
    part = wp.vec2(wp.cos(angle), wp.sin(angle)) * FREE_ROOT
    strand.root = place_between_nodes(tables, strand, first, t, part)
    outward = wp.normalize(strand.root - place_between_nodes(tables, strand, first, t, wp.vec2(0.0, 0.0)))
    strand.direction = leaving_direction(outward, uniform_direction(words[0], words[1]))
    strand.length = free_hair_length(purpose, y, z, w, length)
    return strand


@wp.func
def open_arc(tables: FiberTables, stretch: Stretch, hair: wp.int32) -> Strand:
    """Draw the shape of a hair of equation 11. Twin: `flyaways.sample_hairs`."""
    yarn = tables.yarns[stretch.yarn]
    y = wp.uint32(stretch.yarn)
    z = wp.uint32(stretch.number)
    w = wp.uint32(hair)
    place = pcg4d(tables.seed + PURPOSE_HAIR_PLACE, y, z, w)
    spans = pcg4d(tables.seed + PURPOSE_HAIR_SHAPE, y, z, w)
    span_normal = normal_pair(spans[0], spans[1])
    radius = wp.float32(-1.0)
    radius_span = wp.float32(-1.0)
    for draw in range(1, REDRAWS + 1):
        if radius < 0.0 or radius_span <= 0.0:
            word = pcg4d(tables.seed + PURPOSE_HAIR_SHAPE + wp.uint32(draw), y, z, w)
            normal = normal_pair(word[0], word[1])
            if radius < 0.0:
                radius = yarn.hair_radius[0] + yarn.hair_radius[1] * normal[0]
            if radius_span <= 0.0:
                radius_span = yarn.hair_radius_span[0] + yarn.hair_radius_span[1] * normal[1]
    strand = Strand()
    strand.is_hair = ARC_HAIR
    strand.yarn = stretch.yarn
    strand.first = stretch.first
    strand.segments = tables.hair_segments
    ply = wp.min(wp.int32(uniform(place[2]) * wp.float32(yarn.plies)), yarn.plies - 1)
    strand.fiber = ply * yarn.fibers_per_ply
    strand.ply = angle_of_one_in(ply % yarn.plies_per_cord, yarn.plies_per_cord)
    strand.cord = angle_of_one_in(ply // yarn.plies_per_cord, yarn.cords)
    strand.start = uniform(place[0]) * wp.float32(stretch.segments)
    strand.run = (yarn.hair_z_span[0] + yarn.hair_z_span[1] * span_normal[1]) / yarn.step
    strand.extent = hair_extent(strand.start, strand.run, stretch.first, yarn)
    strand.angle = TWO_PI * uniform(place[1])
    strand.angle_span = yarn.hair_angle_span[0] + yarn.hair_angle_span[1] * span_normal[0]
    strand.radius = wp.min(wp.max(radius, 0.0), yarn.hair_root_limit)
    strand.radius_span = wp.max(radius_span, 0.0)
    return strand


@wp.func
def hair_extent(start: wp.float32, run: wp.float32, first: wp.int32, yarn: YarnParameters) -> wp.float32:
    """Part of a hair that lies on the yarn: hairs are cropped where an open yarn ends."""
    end = start + run
    low = wp.float32(-first)
    high = wp.float32(yarn.intervals - first)
    if yarn.closed != 0 or (end >= low and end <= high):
        return wp.float32(1.0)
    if end < low:
        return (low - start) / run
    return (high - start) / run
