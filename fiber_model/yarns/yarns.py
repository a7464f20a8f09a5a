"""Yarn centerlines: what every yarn source makes and every later stage reads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class YarnSet:
    """Yarns as uniform Catmull-Rom curves through their control points.

    A closed yarn's last point joins its first; the first point is not repeated at the end.
    """

    points: np.ndarray
    """Control points [mm], float64, shape [point_count, 3]; the curve passes through each of them."""
    offsets: np.ndarray
    """First point of each yarn, int64, shape [yarn_count + 1]."""
    closed: np.ndarray
    """Whether the yarn is a loop, bool, shape [yarn_count]."""
    radius: np.ndarray
    """Yarn radius [mm], float64, shape [yarn_count]."""
    yarn_type: np.ndarray
    """Index into `type_names`, int32, shape [yarn_count]."""
    type_names: tuple[str, ...] = ("yarn",)
    """One name per yarn type; each type becomes one medium of the volume."""
    twist: np.ndarray | None = None
    """Material twist against the rotation-minimizing frame [rad], float64, shape [point_count]."""
    surface_uv: np.ndarray | None = None
    """Surface coordinates of each point [1], float64, shape [point_count, 2]."""
