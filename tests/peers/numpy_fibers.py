"""The peer of the fiber kernels: the same points by vectorized numpy, in float32, from the same tables.

As one would write it without Warp: all fibers of a stretch at once, shape [fiber_count, node_count], no loop
over points, blocks that fit the cache, phases by rotations in place of cosines, loops drawn once per
migration period and fiber, not once per point.
"""

from __future__ import annotations

import numpy as np

from weft.fiber_model.counter_random import seed_key
from weft.fiber_model.fibers import FiberSet
from weft.fiber_model.flyaways import FlyawayShape, is_loop, loop_peak, sample_hairs

Pair = tuple[np.ndarray, np.ndarray]


def stretch_points(fibers: FiberSet, stretch: int, shape: FlyawayShape) -> np.ndarray:
    """All strands of one stretch, body fibers and then hairs [mm], float32, shape [point_count, 3]."""
    return np.concatenate([_body(fibers, stretch, shape), hair_points(fibers, stretch, shape)])


def _body(fibers: FiberSet, stretch: int, shape: FlyawayShape) -> np.ndarray:
    piece = fibers.stretches[stretch]
    yarn = fibers.yarns[piece["yarn"]]
    index = piece["first"] + np.arange(piece["segments"] + 1)
    if yarn["closed"]:
        index %= yarn["intervals"]
    nodes = fibers.nodes[yarn["first_node"] + index]
    count = yarn["plies"] * yarn["fibers_per_ply"]
    seats = fibers.seats[yarn["first_fiber"] + np.arange(count)]
    low = (yarn["migration_low"] * seats["radius"])[:, None]
    peak = body_peaks(fibers, int(piece["yarn"]), yarn, seats, index, shape)
    migration = _turned(nodes["migration"], seats["migration"])[0]
    radius = low + np.float32(0.5) * (peak - low) * (migration + np.float32(1.0))
    x, y = _turned(nodes["twist"], seats["angle"])
    ply = _on_circle(np.arange(yarn["plies"], dtype=np.float32) / yarn["plies"])
    c, s = (np.repeat(part, yarn["fibers_per_ply"], axis=0) for part in _turned(nodes["ply"], ply))
    return placed(radius * x, radius * y, (c, s), yarn, nodes).reshape(-1, 3)


def body_peaks(
    fibers: FiberSet, number: int, yarn: np.void, seats: np.ndarray, index: np.ndarray, shape: FlyawayShape
) -> np.ndarray:
    """Largest radius in the migration period of each fiber at each node."""
    own = (yarn["migration_high"] * seats["radius"])[:, None]
    if not yarn["loops"]:
        return own
    turns = index * (yarn["migration_turns"] / yarn["intervals"]) + seats["migration_turns"][:, None]
    period = np.floor(turns + 0.5).astype(np.int32)
    first = period[:, :1]
    nth = period - first
    periods = first + np.arange(nth.min(), nth.max() + 1)
    if yarn["closed"]:
        periods = periods % max(int(yarn["migration_turns"]), 1)
    fiber = np.arange(len(seats))[:, None]
    seed = seed_key(fibers.config.seed)
    peaks = np.broadcast_to(own, periods.shape).copy()
    loops, which = np.nonzero(is_loop(seed, number, fiber, periods, shape.loop_probability))
    peaks[loops, which] = loop_peak(
        seed, number, loops, periods[loops, which], peaks[loops, which], shape.loop_radius
    )
    return np.take_along_axis(peaks, nth - nth.min(), axis=1)


def hair_points(fibers: FiberSet, stretch: int, shape: FlyawayShape) -> np.ndarray:
    piece = fibers.stretches[stretch]
    yarn = fibers.yarns[piece["yarn"]]
    number = np.arange(piece["hairs"])
    hairs = sample_hairs(
        seed_key(fibers.config.seed),
        int(piece["yarn"]),
        np.full_like(number, piece["number"]),
        number,
        int(yarn["plies"]),
        shape,
    )
    begin = piece["first"] + hairs.start * np.float32(piece["segments"])
    run = hairs.z_span / yarn["step"]
    stop = begin + run if yarn["closed"] else np.clip(begin + run, 0, yarn["intervals"])
    extent = np.divide(stop - begin, run, out=np.ones_like(run), where=run != 0)
    steps = fibers.config.hair_segments
    t = extent[:, None] * (np.arange(steps + 1, dtype=np.float32) / np.float32(steps))
    along = begin[:, None] + run[:, None] * t
    whole = np.floor(along).astype(np.int64)
    whole = whole if yarn["closed"] else np.clip(whole, 0, yarn["intervals"] - 1)
    first = yarn["first_node"] + (whole % yarn["intervals"])
    nodes = _between(fibers.nodes, first, (along - whole).astype(np.float32))
    radius = hairs.radius[:, None] + hairs.radius_span[:, None] * t
    angle = np.float32(2 * np.pi) * hairs.angle[:, None] + hairs.angle_span[:, None] * t
    ply = _on_circle(hairs.ply[:, None].astype(np.float32) / yarn["plies"])
    at = nodes["ply"]
    c = at[..., 0] * ply[..., 0] - at[..., 1] * ply[..., 1]
    s = at[..., 1] * ply[..., 0] + at[..., 0] * ply[..., 1]
    return placed(radius * np.cos(angle), radius * np.sin(angle), (c, s), yarn, nodes).reshape(-1, 3)


def _between(nodes: np.ndarray, first: np.ndarray, t: np.ndarray) -> dict[str, np.ndarray]:
    """What hairs use of the nodes, linear between neighbors."""
    t = t[..., None]
    names = ("position", "normal", "binormal", "bend", "ply")
    return {name: nodes[name][first] * (1 - t) + nodes[name][first + 1] * t for name in names}


def _on_circle(turns: np.ndarray) -> np.ndarray:
    angle = np.float32(2 * np.pi) * turns
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _turned(phase: np.ndarray, by: np.ndarray) -> Pair:
    """Cosine and sine of every sum of a node's angle and a fiber's, shape [fiber_count, node_count]."""
    c, s, bc, bs = phase[:, 0], phase[:, 1], by[:, :1], by[:, 1:]
    return c * bc - s * bs, s * bc + c * bs


def placed(x: np.ndarray, y: np.ndarray, ply: Pair, yarn: np.void, nodes: np.ndarray | dict) -> np.ndarray:
    """World points of places in the ply's unit disc, squeezed in tight bends; shape [..., 3]."""
    outward, sideways = yarn["center_radius"] + yarn["ellipse_short"] * x, yarn["ellipse_long"] * y
    c, s = ply
    a, b = c * outward - s * sideways, s * outward + c * sideways
    offset = a[..., None] * nodes["normal"] + b[..., None] * nodes["binormal"]
    bend = np.broadcast_to(nodes["bend"], offset.shape)
    reach = np.einsum("...i,...i", offset, bend)
    tight = reach > np.float32(0.8)
    if tight.any():
        kept = np.float32(0.8) + np.float32(0.15) * (
            1 - np.exp((np.float32(0.8) - reach[tight]) / np.float32(0.15))
        )
        square = (bend[tight] ** 2).sum(axis=-1)
        offset[tight] -= bend[tight] * ((reach[tight] - kept) / square)[:, None]
    return offset + nodes["position"]
