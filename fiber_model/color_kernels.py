"""The color of every point of a fiber, as Warp functions. Twin: `fiber_colors`."""

# mypy: ignore-errors
# Warp reads the annotations, and some of them are calls.

from __future__ import annotations

import warp as wp

from .body_kernels import Strand
from .fiber_kernels import open_strand, strand_count
from .fiber_tables import FiberTables

wp.set_module_options({"enable_backward": False})


@wp.func
def strand_color(tables: FiberTables, strand: Strand, k: wp.int32) -> wp.vec3:
    """Linear RGB at point `k` of an opened strand; a hair has the color of its ply where it begins."""
    yarn = tables.yarns[strand.yarn]
    color = wp.vec3(1.0, 1.0, 1.0)
    if yarn.colors > 0:
        color = tables.colors[yarn.first_color + (strand.fiber // yarn.fibers_per_ply) % yarn.colors]
    if yarn.detailed == 0:
        return color
    index = strand.first + k
    if strand.is_hair != 0:
        index = strand.first + wp.int32(strand.start)
    if yarn.closed != 0 and index >= yarn.intervals:
        index = index - yarn.intervals
    return color * tables.details[yarn.first_node + index].lightness


@wp.kernel
def colors_kernel(
    begin: wp.int32,
    tables: FiberTables,
    stretches: wp.array(dtype=wp.int32),
    offsets: wp.array(dtype=wp.int64),
    colors: wp.array(dtype=wp.vec3),
):
    """Colors of all points of chosen stretches, in the order of `strand_kernels.points_kernel`."""
    i = begin + wp.tid()
    stretch = stretches[i]
    place = offsets[i]
    for s in range(strand_count(tables, stretch)):
        strand = open_strand(tables, stretch, s)
        for k in range(strand.segments + 1):
            colors[place] = strand_color(tables, strand, k)
            place += wp.int64(1)
