"""The color of every point of a fiber: its ply's own, lighter and darker along the yarn. Linear RGB.

For kernels elsewhere: `color_kernels.strand_color(tables, strand, k)`. What follows is the same in numpy.
A color of 1 is white, the fiber as the scattering preset has it; noise may lift a color above 1.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from .fibers import FiberSet


def has_colors(fiber_set: FiberSet) -> bool:
    """Whether any fiber has a color other than white."""
    return bool(len(fiber_set.colors)) or bool((fiber_set.details["lightness"] != 1.0).any())


def ply_color(fiber_set: FiberSet, yarn: int, ply: np.ndarray) -> np.ndarray:
    """Color of plies of a yarn before it varies along the yarn, float32, shape [..., 3]."""
    count, first = (int(fiber_set.yarns[name][yarn]) for name in ("colors", "first_color"))
    ply = np.asarray(ply)
    if count == 0:
        return np.ones((*ply.shape, 3), dtype=np.float32)
    return fiber_set.colors[first + ply % count]


def node_lightness(fiber_set: FiberSet, yarn: int) -> np.ndarray:
    """Factor on the color at each node of a yarn, float32, shape [intervals + 1]."""
    first, intervals = (int(fiber_set.yarns[name][yarn]) for name in ("first_node", "intervals"))
    if not len(fiber_set.details):
        return np.ones(intervals + 1, dtype=np.float32)
    return fiber_set.details["lightness"][first : first + intervals + 1]
