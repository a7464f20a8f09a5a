"""The nodes of all yarns: laid group by group of yarns, on all cores, in memory that is taken once.

Frames are float64 and take as much memory as the nodes made from them, so they live for one group only. A
yarn's nodes depend on the yarn alone, so no grouping changes a bit.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from .config import FibersConfig
from .fiber_arrays import YarnPlan, build_nodes, plan_yarn
from .split_launch import cpu_threads
from .yarns.catmull_rom import norm
from .yarns.frames import MIN_INTERVALS, build_frames
from .yarns.groups import yarn_groups, yarns_of
from .yarns.yarns import YarnSet

GROUP_NODES = 1 << 17
"""Nodes of a group, unless one yarn has more: some 30 MB of frames and temporaries for each core."""

Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class YarnNodes:
    """Nodes of all yarns, and what is planned for each yarn."""

    plans: list[YarnPlan]
    nodes: np.ndarray
    """`fiber_tables.YarnNode` records."""
    offsets: np.ndarray
    """First node of each yarn, int64, shape [yarn_count + 1]."""


def lay_nodes(
    configs: list[FibersConfig],
    yarns: YarnSet,
    segment_mm: float,
    seed: int,
    dtype: np.dtype,
    *,
    progress: Progress | None = None,
) -> YarnNodes:
    """Plan every yarn, cut it into segments of at most `segment_mm`, and make a record of every node."""
    most = most_nodes(yarns, segment_mm)
    # the pages of this array that stay unwritten take no memory
    nodes = np.empty(int(most.sum()), dtype=dtype)
    plans: list[YarnPlan] = []
    filled = 0

    def lay(group: range) -> tuple[list[YarnPlan], np.ndarray]:
        return _lay_group(configs, yarns, group, segment_mm, seed, dtype)

    for own_plans, own_nodes in _in_order(lay, yarn_groups(most, GROUP_NODES)):
        nodes[filled : filled + len(own_nodes)] = own_nodes
        plans += own_plans
        filled += len(own_nodes)
        if progress is not None:
            progress(len(plans) / len(configs), f"yarn {len(plans)} of {len(configs)}")
    offsets = np.cumsum([0] + [plan.intervals + 1 for plan in plans])
    return YarnNodes(plans, nodes[:filled], offsets)


def most_nodes(yarns: YarnSet, segment_mm: float) -> np.ndarray:
    """No yarn has more nodes than this, int64, shape [yarn_count]."""
    groups = yarn_groups(yarns.point_counts)
    length = np.concatenate([_longest(yarns_of(yarns, group)) for group in groups])
    return np.maximum(np.ceil(length / segment_mm * (1 + 1e-9)), MIN_INTERVALS).astype(np.int64) + 1


def _longest(yarns: YarnSet) -> np.ndarray:
    """Upper bound of the length of each yarn [mm], shape [yarn_count].

    A curve is no longer than its Bezier polygon: P1, P1 + (P2 - P0) / 6, P2 - (P3 - P1) / 6, P2.
    """
    points, closed = yarns.points, yarns.closed
    first, last = yarns.offsets[:-1], yarns.offsets[1:] - 1
    ahead, behind = np.arange(1, len(points) + 1), np.arange(-1, len(points) - 1)
    ahead[last], behind[first] = np.where(closed, first, last), np.where(closed, last, first)
    handle = (points[ahead] - points[behind]) / 6
    ends = np.concatenate([first[~closed], last[~closed]])
    handle[ends] *= 2  # an open end goes straight on: twice the last chord stands for P2 - P0
    middle = points[ahead] - points - handle - handle[ahead]
    polygon = norm(handle) + norm(middle) + norm(handle[ahead])
    polygon[last[~closed]] = 0.0
    return np.add.reduceat(polygon, first)


def _in_order(
    lay: Callable[[range], tuple[list[YarnPlan], np.ndarray]], groups: Iterator[range]
) -> Iterator[tuple[list[YarnPlan], np.ndarray]]:
    """Lay groups side by side, few enough at a time to bound the memory, and give them back in order."""
    threads = cpu_threads()
    waiting: deque[Future[tuple[list[YarnPlan], np.ndarray]]] = deque()
    with ThreadPoolExecutor(threads) as pool:
        for group in groups:
            waiting.append(pool.submit(lay, group))
            if len(waiting) > threads:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def _lay_group(
    configs: list[FibersConfig],
    yarns: YarnSet,
    group: range,
    segment_mm: float,
    seed: int,
    dtype: np.dtype,
) -> tuple[list[YarnPlan], np.ndarray]:
    frames = build_frames(yarns_of(yarns, group), max_step_mm=segment_mm)
    plans = [
        plan_yarn(
            configs[yarn], float(yarns.radius[yarn]), float(length), int(intervals), closed=bool(closed)
        )
        for yarn, length, intervals, closed in zip(
            group, frames.length, frames.interval_counts, frames.closed, strict=True
        )
    ]
    return plans, build_nodes(plans, frames, seed, dtype, first_yarn=group.start)
