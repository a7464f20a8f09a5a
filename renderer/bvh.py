"""Bounding volume hierarchy by the surface area heuristic, threaded for walks without a stack.

Built level by level with bins (Wald 2007), all nodes of a level at once. Threads after Hachisuka's
multi-threaded BVH: for each of the six main directions of a ray its own order of children, as links to the
next node where a box is hit and where it is missed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

BINS = 16
LEAF_TRIANGLES = 2
"""Most triangles of a leaf, tested one after the other in geometry/seek.glsl."""
END = 0xFFFFFFFF
"""The link after the last node."""
DIRECTIONS = 6
"""+x, -x, +y, -y, +z, -z: the axis along which a ray moves fastest."""


@dataclass(frozen=True)
class Bvh:
    """Nodes, the root first, every child after its parent."""

    lower: np.ndarray
    """Corners of the boxes, float64, shape [node_count, 3]."""
    upper: np.ndarray
    first: np.ndarray
    """First triangle of a leaf, in the order `order`; int, shape [node_count]."""
    count: np.ndarray
    """Triangles of a leaf; 0 for inner nodes."""
    links: np.ndarray
    """Next node on a hit and on a miss, uint32, shape [node_count, 6, 2]."""
    order: np.ndarray
    """The triangles, by their index before; int, shape [triangle_count]."""


def build_bvh(lower: np.ndarray, upper: np.ndarray, *, leaf: int = LEAF_TRIANGLES) -> Bvh:
    """Over boxes with these corners, float64, shape [triangle_count, 3]; at most `leaf` to a leaf."""
    middle = (lower + upper) / 2
    order = np.arange(len(lower))
    starts, ends = np.array([0]), np.array([len(lower)])
    boxes: list[tuple[np.ndarray, np.ndarray]] = []
    spans: list[tuple[np.ndarray, np.ndarray]] = []
    children: list[np.ndarray] = []
    base = 0
    while len(starts):
        boxes.append(_span_bounds(lower[order], upper[order], starts, ends))
        spans.append((starts, ends))
        inner = ends - starts > leaf
        level_children = np.zeros(len(starts), int)
        level_children[inner] = base + len(starts) + 2 * np.arange(inner.sum())
        children.append(level_children)
        base += len(starts)
        middles = _partition(order, middle, lower, upper, starts[inner], ends[inner])
        starts, ends = (
            np.stack([starts[inner], middles], axis=1).ravel(),
            np.stack([middles, ends[inner]], axis=1).ravel(),
        )
    child = np.concatenate(children)
    box_lower, box_upper = (np.concatenate([box[i] for box in boxes]) for i in (0, 1))
    first, last = (np.concatenate([span[i] for span in spans]) for i in (0, 1))
    count = np.where(child > 0, 0, last - first)
    return Bvh(box_lower, box_upper, first, count, _thread(child, box_lower + box_upper), order)


def empty_bvh() -> Bvh:
    """Of nothing: one node, which is the last, with a box that no ray meets."""
    nothing = np.zeros(1, int)
    links = np.full((1, DIRECTIONS, 2), END, np.uint32)
    return Bvh(np.full((1, 3), 1e30), np.full((1, 3), -1e30), nothing, nothing, links, nothing[:0])


def _span_bounds(
    lower: np.ndarray, upper: np.ndarray, starts: np.ndarray, ends: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of spans of rows; spans are not empty, but need not touch."""
    edges = np.stack([starts, ends], axis=1).ravel()
    edges = edges[:-1] if edges[-1] == len(lower) else edges
    return np.minimum.reduceat(lower, edges)[::2], np.maximum.reduceat(upper, edges)[::2]


def _partition(
    order: np.ndarray,
    middle: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    starts: np.ndarray,
    ends: np.ndarray,
) -> np.ndarray:
    """Sort each span of `order` into two parts, in place; where the second ones start, shape [span_count]."""
    if not len(starts):
        return starts
    sizes = ends - starts
    node = np.repeat(np.arange(len(starts)), sizes)
    rows = np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes) + np.repeat(starts, sizes)
    item = order[rows]
    low, high = _span_bounds(middle[order], middle[order], starts, ends)
    scale = BINS / np.maximum(high - low, 1e-300)
    bins = np.clip(((middle[item] - low[node]) * scale[node]).astype(int), 0, BINS - 1)
    axis, cut = _best_splits(node, bins, lower[item], upper[item], len(starts))
    right = bins[np.arange(len(item)), axis[node]] > cut[node]
    right_counts = np.bincount(node, right, minlength=len(starts)).astype(int)
    hopeless = (right_counts == 0) | (right_counts == sizes)  # all in one bin: halve by order instead
    rank = rows - starts[node]
    right = np.where(hopeless[node], rank >= sizes[node] // 2, right)
    order[rows] = item[np.lexsort((right, node))]
    return ends - np.bincount(node, right, minlength=len(starts)).astype(int)


def _best_splits(
    node: np.ndarray, bins: np.ndarray, lower: np.ndarray, upper: np.ndarray, node_count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Axis and last bin of the left part with the least expected cost, per node."""
    costs = np.empty((node_count, 3, BINS - 1))
    for axis in range(3):
        place = node * BINS + bins[:, axis]
        counts = np.bincount(place, minlength=node_count * BINS).reshape(node_count, BINS)
        low, high = np.full((len(counts), BINS, 3), np.inf), np.full((len(counts), BINS, 3), -np.inf)
        np.minimum.at(low.reshape(-1, 3), place, lower)
        np.maximum.at(high.reshape(-1, 3), place, upper)
        left = _areas_so_far(low, high)[:, :-1]
        right = _areas_so_far(low[:, ::-1], high[:, ::-1])[:, ::-1][:, 1:]
        before = np.cumsum(counts, axis=1)[:, :-1]
        costs[:, axis] = left * before + right * (counts.sum(axis=1, keepdims=True) - before)
    best = costs.reshape(node_count, -1).argmin(axis=1)
    return best // (BINS - 1), best % (BINS - 1)


def _areas_so_far(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Half the surface of the box around the first 1, 2, ... bins; 0 for empty ones."""
    lower, upper = np.minimum.accumulate(low, axis=1), np.maximum.accumulate(high, axis=1)
    x, y, z = np.moveaxis(
        np.where(np.isfinite(lower), upper - np.where(np.isfinite(lower), lower, 0), 0), -1, 0
    )
    return x * y + y * z + z * x


def _thread(child: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Links of all directions. `child`: the first of two, 0 for leaves; `place`: for the order of two."""
    links = np.full((len(child), DIRECTIONS, 2), END, np.uint32)
    parents = np.flatnonzero(child)
    for direction in range(DIRECTIONS):
        axis, sign = direction // 2, 1 - 2 * (direction % 2)
        first, second = child[parents], child[parents] + 1
        swap = sign * (place[second, axis] - place[first, axis]) < 0
        near, far = np.where(swap, second, first), np.where(swap, first, second)
        hit, miss = links[:, direction, 0], links[:, direction, 1]
        hit[parents], miss[near] = near, far
        for parent, last in zip(parents, far, strict=True):  # parents come before their children
            miss[last] = miss[parent]
        leaves = child == 0
        hit[leaves] = miss[leaves]
    return links
