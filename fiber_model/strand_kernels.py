"""What is asked of whole stretches: their points, the length of their fibers, the box around their hairs."""

# mypy: ignore-errors
# Warp reads the annotations, and some of them are calls.

from __future__ import annotations

import warp as wp

from .fiber_kernels import (
    Strand,
    hair_point,
    migration_peak,
    open_hair,
    open_strand,
    open_strand_point,
    strand_count,
)
from .fiber_tables import FiberTables

wp.set_module_options({"enable_backward": False})

KIND_BODY = wp.constant(0)
KIND_LOOP = wp.constant(1)
KIND_HAIR = wp.constant(2)


@wp.func
def strand_kind(tables: FiberTables, strand: Strand, k: wp.int32) -> wp.int32:
    """Whether point `k` belongs to a hair, to a loop, or to neither."""
    if strand.is_hair != 0:
        return KIND_HAIR
    yarn = tables.yarns[strand.yarn]
    index = strand.first + k
    if yarn.closed != 0 and index == yarn.intervals:
        index = wp.int32(0)
    peak = migration_peak(tables, yarn, strand, index)
    if peak > yarn.migration_high * strand.seat.radius:
        return KIND_LOOP
    return KIND_BODY


@wp.kernel
def points_kernel(
    tables: FiberTables,
    stretches: wp.array(dtype=wp.int32),
    offsets: wp.array(dtype=wp.int64),
    points: wp.array(dtype=wp.vec3),
    kinds: wp.array(dtype=wp.uint8),
):
    """All strands of chosen stretches, one after the other: stretch i writes from point offsets[i] on."""
    i = wp.tid()
    stretch = stretches[i]
    place = offsets[i]
    for s in range(strand_count(tables, stretch)):
        strand = open_strand(tables, stretch, s)
        for k in range(strand.segments + 1):
            points[place] = open_strand_point(tables, strand, k)
            kinds[place] = wp.uint8(strand_kind(tables, strand, k))
            place += wp.int64(1)


@wp.kernel
def length_kernel(tables: FiberTables, length: wp.array(dtype=wp.float64, ndim=2)):
    """Length of the body fibers and of the hairs of each stretch [mm], shape [stretch_count, 2]."""
    stretch = wp.tid()
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


@wp.kernel
def hair_bounds_kernel(tables: FiberTables, bounds: wp.array(dtype=wp.vec3, ndim=2)):
    """Grow the box of each stretch, shape [stretch_count, 2], by the hairs that begin in it."""
    stretch = wp.tid()
    piece = tables.stretches[stretch]
    low = bounds[stretch, 0]
    high = bounds[stretch, 1]
    for h in range(piece.hairs):
        strand = open_hair(tables, piece, h)
        for k in range(strand.segments + 1):
            point = hair_point(tables, strand, k)
            low = wp.min(low, point)
            high = wp.max(high, point)
    bounds[stretch, 0] = low
    bounds[stretch, 1] = high
