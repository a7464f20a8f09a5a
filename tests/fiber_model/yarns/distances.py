"""Smallest distance between yarns, in units at which they touch."""

import numpy as np
from scipy.spatial import cKDTree

from weft.fiber_model.yarns.frames import build_frames
from weft.fiber_model.yarns.yarns import YarnSet


def clearance(yarns: YarnSet) -> float:
    """Least distance between different centerlines over the sum of their radii; 1 where yarns touch."""
    frames = build_frames(yarns, max_step_mm=float(yarns.radius.min()) / 16)
    owner = np.repeat(np.arange(yarns.yarn_count), np.diff(frames.offsets))
    least = np.inf
    for yarn in range(yarns.yarn_count):
        others = owner != yarn
        distance, nearest = cKDTree(frames.position[others]).query(frames.position[~others])
        touching = yarns.radius[yarn] + yarns.radius[owner[others][nearest]]
        least = min(least, float((distance / touching).min()))
    return least


def own_clearance(yarns: YarnSet, yarn: int) -> float:
    """The same for one yarn with itself, leaving out stretches closer than 4 radii along it."""
    frames = build_frames(yarns, max_step_mm=float(yarns.radius.min()) / 8)
    x = frames.position[frames.offsets[yarn] : frames.offsets[yarn + 1]]
    radius, gap = yarns.radius[yarn], int(4 * yarns.radius[yarn] / frames.step[yarn])
    pairs = cKDTree(x).query_pairs(2.5 * radius, output_type="ndarray")
    pairs = pairs[pairs[:, 1] - pairs[:, 0] > gap]
    if not len(pairs):
        return 1.25
    return float(np.linalg.norm(x[pairs[:, 0]] - x[pairs[:, 1]], axis=1).min() / (2 * radius))
