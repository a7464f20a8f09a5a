"""What the fibers are a function of, as Warp structs: one record per yarn node, yarn, fiber and stretch.

Their numpy view is the layout of the arrays in a `FiberSet`. A node is a point of the yarn where segments
meet. All lengths in mm.
"""

# mypy: ignore-errors
# Warp reads the annotations, and some of them are calls.

from __future__ import annotations

from typing import Any

import warp as wp


@wp.struct
class YarnNode:
    """One node of a yarn: where it is, how it is turned, and the phases there as (cosine, sine)."""

    position: wp.vec3
    normal: wp.vec3
    binormal: wp.vec3
    bend: wp.vec3
    """Derivative of the tangent by arc length [1/mm]: points to the center of curvature."""
    ply: wp.vec2
    """Angle of ply 0."""
    twist: wp.vec2
    """Angle of the fiber twist within a ply."""
    migration: wp.vec2
    """Phase of a migration that begins at 0."""


@wp.struct
class NodeDetail:
    """What a node has besides where a yarn varies along its length or has cords."""

    thickness: wp.float32
    """Factor on all offsets from the yarn's center."""
    lightness: wp.float32
    """Factor on the color."""
    cord: wp.vec2
    """Angle of cord 0 as (cosine, sine)."""


@wp.struct
class YarnParameters:
    """What is one value for a whole yarn."""

    first_node: wp.int32
    intervals: wp.int32
    closed: wp.int32
    first_fiber: wp.int32
    plies: wp.int32
    """Plies of all cords together."""
    plies_per_cord: wp.int32
    fibers_per_ply: wp.int32
    """Seats of a ply; a stretch may have fewer fibers."""
    detailed: wp.int32
    """Whether the yarn's nodes have a `NodeDetail`."""
    cords: wp.int32
    cord_radius: wp.float32
    """Distance of the cords' centers from the yarn's center."""
    first_color: wp.int32
    colors: wp.int32
    """How many colors its plies take in turn; 0 for white."""
    step: wp.float32
    """Length of yarn per segment."""
    center_radius: wp.float32
    ellipse_short: wp.float32
    ellipse_long: wp.float32
    migration_low: wp.float32
    migration_high: wp.float32
    migration_turns: wp.float64
    """Migration periods in the whole yarn."""
    migration_rate: wp.float64
    """Migration periods per segment."""
    loops: wp.int32
    """Whether there are loops at all."""
    loop_threshold: wp.uint32
    loop_radius: wp.vec2
    """Mean and standard deviation; likewise below."""
    hair_radius: wp.vec2
    hair_radius_span: wp.vec2
    hair_angle_span: wp.vec2
    hair_z_span: wp.vec2
    hair_root_limit: wp.float32
    perturbation: wp.float32
    perturbation_cells: wp.int32
    """Lattice cells of the perturbation in the whole yarn."""


@wp.struct
class FreeHairParameters:
    """Walks and droops of a whole yarn; apart from `YarnParameters`, which every point reads."""

    walk_length: wp.vec2
    """Mean and standard deviation; likewise below."""
    persistence: wp.float32
    droop_length: wp.vec2
    bend: wp.float32
    down: wp.vec3


@wp.struct
class FiberSeat:
    """Where one fiber sits in its ply, and where its migration begins."""

    radius: wp.float32
    angle: wp.vec2
    migration: wp.vec2
    migration_turns: wp.float32
    """The same phase as `migration`, in turns."""


@wp.struct
class Stretch:
    """A piece of yarn: the segments made at a time."""

    yarn: wp.int32
    number: wp.int32
    """Which stretch of its yarn."""
    first: wp.int32
    """Its first node, counted from the yarn's."""
    segments: wp.int32
    fibers_per_ply: wp.int32
    """Fibers of each ply that are there, the first ones."""
    hairs: wp.int32
    """Hairs of all kinds that begin in it: those of equation 11 come first, then walks, then droops."""
    walks: wp.int32
    droops: wp.int32


@wp.struct
class FiberTables:
    """All that the fibers are a function of, on one device."""

    seed: wp.uint32
    hair_segments: wp.int32
    nodes: wp.array(dtype=YarnNode)
    yarns: wp.array(dtype=YarnParameters)
    seats: wp.array(dtype=FiberSeat)
    stretches: wp.array(dtype=Stretch)
    details: wp.array(dtype=NodeDetail)
    """Of all nodes, or nothing where no yarn is detailed."""
    free_hairs: wp.array(dtype=FreeHairParameters)
    colors: wp.array(dtype=wp.vec3)


RECORDS: dict[str, Any] = {
    "nodes": YarnNode,
    "yarns": YarnParameters,
    "seats": FiberSeat,
    "stretches": Stretch,
    "details": NodeDetail,
    "free_hairs": FreeHairParameters,
}


def to_device(seed: int, hair_segments: int, device: str, **arrays: Any) -> FiberTables:
    """`FiberTables` on a device from numpy arrays of the structs' types; on the CPU they are not copied."""
    tables = FiberTables()
    tables.seed = seed
    tables.hair_segments = hair_segments
    for name, struct in RECORDS.items():
        copy = not wp.get_device(device).is_cpu
        setattr(tables, name, wp.array(arrays[name], dtype=struct, device=device, copy=copy))
    tables.colors = wp.array(arrays["colors"], dtype=wp.vec3, device=device)
    return tables
