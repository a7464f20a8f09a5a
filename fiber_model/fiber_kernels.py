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

from .body_kernels import Strand, angle_of_one_in, body_point, migration_period, period_peak
from .fiber_tables import FiberTables
from .hair_kernels import hair_point, open_hair

wp.set_module_options({"enable_backward": False})


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
