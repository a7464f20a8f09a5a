"""Body fibers as Warp functions: loops, migration, and from a place in a ply to a point of space.

Twins: cross_section.py, migration.py, plies.py and flyaways.py.
"""

# mypy: ignore-errors
# Warp reads the annotations, and some of them are calls.

from __future__ import annotations

import warp as wp

from . import counter_random
from .fiber_tables import FiberSeat, FiberTables, YarnParameters
from .place_kernels import blend_details, blend_nodes, place_in_cord, place_in_ply, turn
from .random_kernels import TWO_PI, normal_pair, pcg4d, uniform

wp.set_module_options({"enable_backward": False})

REDRAWS = wp.constant(counter_random.REDRAWS)
PURPOSE_LOOP = wp.constant(wp.uint32(counter_random.PURPOSE_LOOP))
PURPOSE_PERTURBATION = wp.constant(wp.uint32(counter_random.PURPOSE_PERTURBATION))


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
def angle_of_one_in(index: wp.int32, count: wp.int32) -> wp.vec2:
    """Cosine and sine of the angle of one of `count` things around a circle."""
    angle = TWO_PI * wp.float32(index) / wp.float32(count)
    return wp.vec2(wp.cos(angle), wp.sin(angle))
