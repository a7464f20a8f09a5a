"""What is asked of whole stretches: their points, the length of their fibers, the box around their hairs.

Kernels for `split_launch.launch_split`: item `begin + wp.tid()` is theirs.
"""

# mypy: ignore-errors
# Warp reads the annotations, and some of them are calls.

from __future__ import annotations

import warp as wp

from .body_kernels import Strand, body_point_at, migration_peak, node_index, period_end
from .fiber_kernels import open_strand, open_strand_point, strand_count
from .fiber_tables import FiberTables, Stretch, YarnParameters
from .hair_kernels import hair_point, open_hair

wp.set_module_options({"enable_backward": False})

KIND_BODY = wp.constant(0)
KIND_LOOP = wp.constant(1)
KIND_HAIR = wp.constant(2)


@wp.func
def write_hair(
    tables: FiberTables,
    strand: Strand,
    place: wp.int64,
    points: wp.array(dtype=wp.vec3),
    kinds: wp.array(dtype=wp.uint8),
):
    """Points of one hair, from place `place` on."""
    for k in range(strand.segments + 1):
        points[place + wp.int64(k)] = hair_point(tables, strand, k)
        kinds[place + wp.int64(k)] = wp.uint8(KIND_HAIR)


@wp.func
def write_body(
    tables: FiberTables,
    yarn: YarnParameters,
    strand: Strand,
    place: wp.int64,
    points: wp.array(dtype=wp.vec3),
    kinds: wp.array(dtype=wp.uint8),
):
    """Points of one body fiber, from place `place` on, and whether each lies in a loop."""
    own = yarn.migration_high * strand.seat.radius
    k = wp.int32(0)
    while k <= strand.segments:
        index = node_index(yarn, strand, k)
        peak = migration_peak(tables, yarn, strand, index)
        after = period_end(yarn, strand, k)
        kind = wp.uint8(KIND_BODY)
        if peak > own:
            kind = wp.uint8(KIND_LOOP)
        for j in range(k, after):
            points[place + wp.int64(j)] = body_point_at(tables, yarn, strand, index + (j - k), peak)
            kinds[place + wp.int64(j)] = kind
        k = after


@wp.kernel
def points_kernel(
    begin: wp.int32,
    tables: FiberTables,
    stretches: wp.array(dtype=wp.int32),
    offsets: wp.array(dtype=wp.int64),
    points: wp.array(dtype=wp.vec3),
    kinds: wp.array(dtype=wp.uint8),
):
    """All strands of chosen stretches, one after the other: stretch i writes from point offsets[i] on."""
    i = begin + wp.tid()
    stretch = stretches[i]
    place = offsets[i]
    yarn = tables.yarns[tables.stretches[stretch].yarn]
    for s in range(strand_count(tables, stretch)):
        strand = open_strand(tables, stretch, s)
        if strand.is_hair != 0:
            write_hair(tables, strand, place, points, kinds)
        else:
            write_body(tables, yarn, strand, place, points, kinds)
        place += wp.int64(strand.segments + 1)


@wp.kernel
def length_kernel(begin: wp.int32, tables: FiberTables, length: wp.array(dtype=wp.float64, ndim=2)):
    """Length of the body fibers and of the hairs of each stretch [mm], shape [stretch_count, 2]."""
    stretch = begin + wp.tid()
    body = wp.float64(0.0)
    hairs = wp.float64(0.0)
    for s in range(strand_count(tables, stretch)):
        strand = open_strand(tables, stretch, s)
        before = open_strand_point(tables, strand, 0)
        for k in range(1, strand.segments + 1):
            point = open_strand_point(tables, strand, k)
            step = wp.vec3d(point) - wp.vec3d(before)
            if strand.is_hair != 0:
                hairs += wp.length(step)
            else:
                body += wp.length(step)
            before = point
    length[stretch, 0] = body
    length[stretch, 1] = hairs


@wp.func
def body_bounds(tables: FiberTables, piece: Stretch, reach: wp.float64):
    """Corners of a box around the body fibers: around the nodes, grown by `reach` times the thickness."""
    yarn = tables.yarns[piece.yarn]
    first = yarn.first_node + piece.first
    low = tables.nodes[first].position
    high = low
    thickness = wp.float32(0.0)
    for k in range(piece.segments + 1):
        low = wp.min(low, tables.nodes[first + k].position)
        high = wp.max(high, tables.nodes[first + k].position)
        if yarn.detailed != 0:
            thickness = wp.max(thickness, tables.details[first + k].thickness)
    grown = reach
    if yarn.detailed != 0:
        grown = reach * wp.float64(thickness)
    by = wp.vec3d(grown, grown, grown)
    return wp.vec3(wp.vec3d(low) - by), wp.vec3(wp.vec3d(high) + by)


@wp.kernel
def bounds_kernel(
    begin: wp.int32,
    tables: FiberTables,
    reach: wp.array(dtype=wp.float64),
    bounds: wp.array(dtype=wp.vec3, ndim=2),
):
    """Box around each stretch, shape [stretch_count, 2]; `reach` of the body fibers of each yarn [mm]."""
    stretch = begin + wp.tid()
    piece = tables.stretches[stretch]
    low, high = body_bounds(tables, piece, reach[piece.yarn])
    for h in range(piece.hairs):
        strand = open_hair(tables, piece, h)
        for k in range(strand.segments + 1):
            point = hair_point(tables, strand, k)
            low = wp.min(low, point)
            high = wp.max(high, point)
    bounds[stretch, 0] = low
    bounds[stretch, 1] = high
