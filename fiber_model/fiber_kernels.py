"""Every point of every fiber as a Warp function: Zhao, Luan and Bala 2016 along yarns, on CPU and GPU alike.

The equations are in cross_section.py, migration.py, plies.py and flyaways.py; `FiberTables` holds what
depends on the yarn, the node or the fiber alone, so that a point of a body fiber costs no trigonometry. A
node is a point of the yarn where segments meet. All lengths in mm; "part" is a distance in the ply's unit
disc.

For kernels elsewhere: `strand_segment_count` and `strand_point`. Where many points of one strand are wanted,
open it once: `strand = open_strand(tables, stretch, index)`, then `open_strand_point(tables, strand, k)`; the
same bits.
"""

# mypy: ignore-errors
# Warp reads the annotations, and some of them are calls.

from __future__ import annotations

import warp as wp

from . import counter_random, free_hairs
from .fiber_tables import FiberSeat, FiberTables, Stretch, YarnParameters
from .free_hair_kernels import droop_point, free_hair_length, leaving_direction, uniform_direction, walk_point
from .place_kernels import blend_details, blend_nodes, place_in_cord, place_in_ply, turn
from .random_kernels import TWO_PI, normal_pair, pcg4d, uniform

wp.set_module_options({"enable_backward": False})

REDRAWS = wp.constant(counter_random.REDRAWS)
PURPOSE_LOOP = wp.constant(wp.uint32(counter_random.PURPOSE_LOOP))
PURPOSE_HAIR_PLACE = wp.constant(wp.uint32(counter_random.PURPOSE_HAIR_PLACE))
PURPOSE_HAIR_SHAPE = wp.constant(wp.uint32(counter_random.PURPOSE_HAIR_SHAPE))
PURPOSE_PERTURBATION = wp.constant(wp.uint32(counter_random.PURPOSE_PERTURBATION))
PURPOSE_WALK = wp.constant(wp.uint32(counter_random.PURPOSE_WALK))
PURPOSE_DROOP = wp.constant(wp.uint32(counter_random.PURPOSE_DROOP))
FREE_ROOT = wp.constant(wp.float32(free_hairs.ROOT))
ARC_HAIR = wp.constant(1)
WALK_HAIR = wp.constant(2)
DROOP_HAIR = wp.constant(3)


@wp.struct
class Strand:
    """One strand within a stretch, ready to give points. Hairs use the second half."""

    is_hair: wp.int32
    """0 for a body fiber, else ARC_HAIR, WALK_HAIR or DROOP_HAIR."""
    yarn: wp.int32
    fiber: wp.int32
    first: wp.int32
    segments: wp.int32
    ply: wp.vec2
    """Angle of its ply against ply 0 of its cord."""
    cord: wp.vec2
    """Angle of its cord against cord 0."""
    seat: FiberSeat
    period: wp.int32
    """Migration period where it begins."""
    peak: wp.float32
    """Largest radius in that period, and in the next."""
    next_peak: wp.float32
    start: wp.float32
    """Where a hair begins, in segments from the yarn's node `first`."""
    run: wp.float32
    """How far it goes along the yarn, in segments."""
    extent: wp.float32
    """Part of it that lies on the yarn: less than 1 where an open yarn ends."""
    angle: wp.float32
    angle_span: wp.float32
    radius: wp.float32
    radius_span: wp.float32
    root: wp.vec3
    """Where a free hair begins; the second half of its own."""
    direction: wp.vec3
    length: wp.float32
    stretch: wp.int32
    """Number of its stretch, and which hair it is there."""
    hair: wp.int32


@wp.func
def loop_peak(
    seed: wp.uint32, yarn: wp.int32, fiber: wp.int32, period: wp.int32, own: wp.float32, radius: wp.vec2
) -> wp.float32:
    """R_loop, a normal drawn until it is above the fiber's own peak. Twin: `flyaways.loop_peak`."""
    for draw in range(1, REDRAWS + 1):
        word = pcg4d(
            seed + PURPOSE_LOOP + wp.uint32(draw), wp.uint32(yarn), wp.uint32(fiber), wp.uint32(period)
        )
        normal = normal_pair(word[1], word[2])
        drawn = radius[0] + radius[1] * normal[0]
        if drawn > own:
            return drawn
    return own


@wp.func
def migration_period(yarn: YarnParameters, seat: FiberSeat, node: wp.int32) -> wp.int32:
    """Which migration period of a fiber a node lies in. Twin: `migration.migration_period_index`."""
    turns = wp.float64(node) * yarn.migration_rate + wp.float64(seat.migration_turns)
    return wp.int32(wp.floor(turns + wp.float64(0.5)))


@wp.func
def period_peak(
    seed: wp.uint32,
    yarn: YarnParameters,
    yarn_index: wp.int32,
    fiber: wp.int32,
    seat: FiberSeat,
    period: wp.int32,
) -> wp.float32:
    """Largest radius in a migration period: the fiber's own, or that of a loop."""
    own = yarn.migration_high * seat.radius
    if yarn.closed != 0:
        period = period % wp.max(wp.int32(yarn.migration_turns), 1)
    word = pcg4d(seed + PURPOSE_LOOP, wp.uint32(yarn_index), wp.uint32(fiber), wp.uint32(period))
    if word[0] > yarn.loop_threshold:
        return own
    return loop_peak(seed, yarn_index, fiber, period, own, yarn.loop_radius)


@wp.func
def migration_peak(tables: FiberTables, yarn: YarnParameters, strand: Strand, node: wp.int32) -> wp.float32:
    """Largest radius in the migration period around a node; opening the strand has found two of them."""
    if yarn.loops == 0:
        return yarn.migration_high * strand.seat.radius
    period = migration_period(yarn, strand.seat, node)
    if period == strand.period:
        return strand.peak
    if period == strand.period + 1:
        return strand.next_peak
    return period_peak(tables.seed, yarn, strand.yarn, strand.fiber, strand.seat, period)


@wp.func
def period_end(yarn: YarnParameters, strand: Strand, k: wp.int32) -> wp.int32:
    """First point after `k` that is in another migration period or beyond the strand.

    A guess by division, put right by the test that every point is subject to. The last point of a closed yarn
    is its first one and stands alone.
    """
    last = strand.segments
    if yarn.closed != 0 and strand.first + last == yarn.intervals:
        if k == last:
            return last + 1
        last = last - 1
    if yarn.loops == 0:
        return last + 1
    period = migration_period(yarn, strand.seat, strand.first + k)
    border = (
        wp.float64(period) + wp.float64(0.5) - wp.float64(strand.seat.migration_turns)
    ) / yarn.migration_rate
    after = last + 1
    if border < wp.float64(strand.first + last + 1):
        after = wp.max(wp.int32(wp.ceil(border)) - strand.first, k + 1)
    while after > k + 1 and migration_period(yarn, strand.seat, strand.first + after - 1) != period:
        after = after - 1
    while after <= last and migration_period(yarn, strand.seat, strand.first + after) == period:
        after = after + 1
    return after


@wp.func
def lattice_value(seed: wp.uint32, yarn: wp.int32, fiber: wp.int32, cell: wp.int32) -> wp.float32:
    """Uniform in (-1, 1) at a lattice point of the perturbation."""
    word = pcg4d(seed + PURPOSE_PERTURBATION, wp.uint32(yarn), wp.uint32(fiber), wp.uint32(cell))
    return 2.0 * uniform(word[0]) - 1.0


@wp.func
def perturbation_factor(
    seed: wp.uint32, yarn: YarnParameters, yarn_index: wp.int32, fiber: wp.int32, node: wp.int32
) -> wp.float32:
    """1 plus smooth noise: lattice values joined by the cubic 3 t^2 - 2 t^3."""
    place = wp.float64(node) * (wp.float64(yarn.perturbation_cells) / wp.float64(yarn.intervals))
    cell = wp.int32(wp.floor(place))
    t = wp.float32(place - wp.float64(cell))
    after = cell + 1
    if yarn.closed != 0:
        after = after % yarn.perturbation_cells
    low = lattice_value(seed, yarn_index, fiber, cell)
    high = lattice_value(seed, yarn_index, fiber, after)
    return 1.0 + yarn.perturbation * (low + (high - low) * t * t * (3.0 - 2.0 * t))


@wp.func
def body_point(tables: FiberTables, strand: Strand, k: wp.int32) -> wp.vec3:
    """Node `k` of a body fiber, loops included."""
    yarn = tables.yarns[strand.yarn]
    index = node_index(yarn, strand, k)
    return body_point_at(tables, yarn, strand, index, migration_peak(tables, yarn, strand, index))


@wp.func
def node_index(yarn: YarnParameters, strand: Strand, k: wp.int32) -> wp.int32:
    """Node of the yarn at point `k` of a body fiber; the last of a closed yarn is its first."""
    index = strand.first + k
    if yarn.closed != 0 and index == yarn.intervals:
        index = wp.int32(0)
    return index


@wp.func
def body_point_at(
    tables: FiberTables, yarn: YarnParameters, strand: Strand, index: wp.int32, peak: wp.float32
) -> wp.vec3:
    """A body fiber at a node of its yarn, where the caller knows the yarn and the period's largest radius."""
    node = tables.nodes[yarn.first_node + index]
    low = yarn.migration_low * strand.seat.radius
    migration = turn(node.migration, strand.seat.migration)
    radius = low + 0.5 * (peak - low) * (migration[0] + 1.0)
    if yarn.perturbation > 0.0:
        radius = radius * perturbation_factor(tables.seed, yarn, strand.yarn, strand.fiber, index)
    part = turn(node.twist, strand.seat.angle) * radius
    ply = turn(node.ply, strand.ply)
    if yarn.detailed != 0:
        detail = tables.details[yarn.first_node + index]
        return place_in_cord(part, ply, strand.cord, detail, yarn, node)
    return place_in_ply(part, ply, yarn, node)


@wp.func
def place_between_nodes(
    tables: FiberTables, strand: Strand, first: wp.int32, t: wp.float32, part: wp.vec2
) -> wp.vec3:
    """World position of a point of the strand's ply, at a part of the way from one node to the next."""
    yarn = tables.yarns[strand.yarn]
    node = blend_nodes(tables.nodes[first], tables.nodes[first + 1], t)
    ply = turn(node.ply, strand.ply)
    if yarn.detailed != 0:
        detail = blend_details(tables.details[first], tables.details[first + 1], t)
        return place_in_cord(part, ply, strand.cord, detail, yarn, node)
    return place_in_ply(part, ply, yarn, node)


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
def angle_of_one_in(index: wp.int32, count: wp.int32) -> wp.vec2:
    """Cosine and sine of the angle of one of `count` things around a circle."""
    angle = TWO_PI * wp.float32(index) / wp.float32(count)
    return wp.vec2(wp.cos(angle), wp.sin(angle))


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


@wp.func
def open_strand(tables: FiberTables, stretch_index: wp.int32, strand_index: wp.int32) -> Strand:
    """Prepare one strand of a stretch: body fibers come first, then the hairs that begin in it."""
    stretch = tables.stretches[stretch_index]
    yarn = tables.yarns[stretch.yarn]
    body = yarn.plies * stretch.fibers_per_ply
    if strand_index >= body:
        return open_hair(tables, stretch, strand_index - body)
    ply = strand_index // stretch.fibers_per_ply
    strand = Strand()
    strand.is_hair = 0
    strand.yarn = stretch.yarn
    strand.fiber = ply * yarn.fibers_per_ply + strand_index - ply * stretch.fibers_per_ply
    strand.first = stretch.first
    strand.segments = stretch.segments
    strand.ply = angle_of_one_in(ply % yarn.plies_per_cord, yarn.plies_per_cord)
    if yarn.cords > 1:
        strand.cord = angle_of_one_in(ply // yarn.plies_per_cord, yarn.cords)
    else:
        strand.cord = wp.vec2(1.0, 0.0)
    strand.seat = tables.seats[yarn.first_fiber + strand.fiber]
    if yarn.loops != 0:
        seat = strand.seat
        strand.period = migration_period(yarn, seat, strand.first)
        strand.peak = period_peak(tables.seed, yarn, strand.yarn, strand.fiber, seat, strand.period)
        strand.next_peak = period_peak(tables.seed, yarn, strand.yarn, strand.fiber, seat, strand.period + 1)
    return strand


@wp.func
def open_strand_point(tables: FiberTables, strand: Strand, k: wp.int32) -> wp.vec3:
    """Point `k` of an opened strand [mm], k in 0..strand.segments."""
    if strand.is_hair != 0:
        return hair_point(tables, strand, k)
    return body_point(tables, strand, k)


@wp.func
def strand_count(tables: FiberTables, stretch: wp.int32) -> wp.int32:
    """Strands of a stretch: its body fibers, then its hairs."""
    piece = tables.stretches[stretch]
    yarn = tables.yarns[piece.yarn]
    return yarn.plies * piece.fibers_per_ply + piece.hairs


@wp.func
def strand_segment_count(tables: FiberTables, stretch: wp.int32, strand: wp.int32) -> wp.int32:
    """Segments of one strand of a stretch."""
    piece = tables.stretches[stretch]
    yarn = tables.yarns[piece.yarn]
    if strand < yarn.plies * piece.fibers_per_ply:
        return piece.segments
    return tables.hair_segments


@wp.func
def strand_point(tables: FiberTables, stretch: wp.int32, strand: wp.int32, k: wp.int32) -> wp.vec3:
    """Point `k` of one strand of a stretch [mm], k in 0..strand_segment_count.

    The last point of a body fiber in a stretch equals its first in the next one, bit for bit.
    """
    return open_strand_point(tables, open_strand(tables, stretch, strand), k)
