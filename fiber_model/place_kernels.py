"""From a place in a ply to a point of space, as Warp functions: plies, cords, and tight bends."""

# mypy: ignore-errors
# Warp reads the annotations, and some of them are calls.

from __future__ import annotations

import warp as wp

from .fiber_tables import NodeDetail, YarnNode, YarnParameters

wp.set_module_options({"enable_backward": False})

BEND_FREE = wp.constant(wp.float32(0.8))
"""Curvature times offset up to which an offset toward the center of curvature is left alone."""
BEND_ROOM = wp.constant(wp.float32(0.15))
"""What is left above that: offsets are squeezed into it, so curvature times offset stays below 0.95."""


@wp.func
def turn(phase: wp.vec2, by: wp.vec2) -> wp.vec2:
    """Cosine and sine of the sum of two angles given by theirs."""
    return wp.vec2(phase[0] * by[0] - phase[1] * by[1], phase[1] * by[0] + phase[0] * by[1])


@wp.func
def keep_from_folding(offset: wp.vec3, bend: wp.vec3) -> wp.vec3:
    """Squeeze an offset that nears the center of curvature, where the fibers of a tight bend would fold over.

    Smooth and one to one: curvature times offset d becomes 0.8 + 0.15 (1 - exp(-(d - 0.8) / 0.15)) above 0.8.
    """
    reach = wp.dot(bend, offset)
    if reach <= BEND_FREE:
        return offset
    kept = BEND_FREE + BEND_ROOM * (1.0 - wp.exp((BEND_FREE - reach) / BEND_ROOM))
    return offset - bend * ((reach - kept) / wp.dot(bend, bend))


@wp.func
def place_in_ply(part: wp.vec2, ply: wp.vec2, yarn: YarnParameters, node: YarnNode) -> wp.vec3:
    """World position of a point of the ply's unit disc. Twin: `plies.place_in_ply`."""
    outward = yarn.center_radius + yarn.ellipse_short * part[0]
    sideways = yarn.ellipse_long * part[1]
    offset = node.normal * (ply[0] * outward - ply[1] * sideways) + node.binormal * (
        ply[1] * outward + ply[0] * sideways
    )
    return node.position + keep_from_folding(offset, node.bend)


@wp.func
def place_in_cord(
    part: wp.vec2, ply: wp.vec2, cord: wp.vec2, detail: NodeDetail, yarn: YarnParameters, node: YarnNode
) -> wp.vec3:
    """The same where the ply belongs to a cord or the yarn varies. Twin: `plies.place_in_cord`."""
    outward = yarn.center_radius + yarn.ellipse_short * part[0]
    sideways = yarn.ellipse_long * part[1]
    in_cord = turn(wp.vec2(outward, sideways), ply)
    plane = (
        turn(wp.vec2(yarn.cord_radius + in_cord[0], in_cord[1]), turn(detail.cord, cord)) * detail.thickness
    )
    offset = node.normal * plane[0] + node.binormal * plane[1]
    return node.position + keep_from_folding(offset, node.bend)


@wp.func
def blend_nodes(a: YarnNode, b: YarnNode, t: wp.float32) -> YarnNode:
    """The yarn between two nodes, linear in all that hairs use."""
    node = YarnNode()
    node.position = wp.lerp(a.position, b.position, t)
    node.normal = wp.lerp(a.normal, b.normal, t)
    node.binormal = wp.lerp(a.binormal, b.binormal, t)
    node.bend = wp.lerp(a.bend, b.bend, t)
    node.ply = wp.lerp(a.ply, b.ply, t)
    return node


@wp.func
def blend_details(a: NodeDetail, b: NodeDetail, t: wp.float32) -> NodeDetail:
    detail = NodeDetail()
    detail.thickness = wp.lerp(a.thickness, b.thickness, t)
    detail.lightness = wp.lerp(a.lightness, b.lightness, t)
    detail.cord = wp.lerp(a.cord, b.cord, t)
    return detail
