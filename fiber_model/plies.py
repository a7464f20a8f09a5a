"""Plies: elliptical bundles on a helix around the yarn's center. Zhao, Luan and Bala 2016, equations 2 and 4.

In the ply, a fiber at radius R and angle theta lies at (R cos theta, R sin theta) of a unit disc; theta
turns once per fiber pitch, measured against the ply. The disc is stretched to an ellipse whose short axis
e_Y points to the yarn's center and whose long axis e_X lies along the circle of ply centers; the ellipses
may intersect, which stands for compression. Ply p of K stands at angle 2 pi (z / ply pitch + p / K) on a
circle of radius R_ply; z is arc length.

Cords (ply of plies, not in the paper): cord c of C stands at angle 2 pi (z / cord pitch + c / C) on a
circle of radius R_cord, and its plies turn around its center as they would around the yarn's, measured
against the cord as fibers are against their ply. Cords are round and touch each other and the yarn's radius
r: R_cord = r - r_cord, r_cord = r sin(pi / C) / (1 + sin(pi / C)).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .config import FibersConfig
from .counter_random import PURPOSE_PLY_PHASE, pcg4d, uniform


@dataclass(frozen=True)
class PlyShape:
    """Measures of the plies of one yarn, after scaling [mm]."""

    center_radius: float
    long: float
    short: float
    ply_pitch: float
    fiber_pitch: float
    fibers_per_ply: int
    scale: float
    """Size of this yarn, or of each of its cords, over the preset's own [1]."""
    cord_center_radius: float = 0.0
    cord_pitch: float = 0.0

    @property
    def mean_radius(self) -> float:
        """sqrt(e_X e_Y): what distances of fly-aways from the ply center are measured against."""
        return float(np.sqrt(self.long * self.short))


def cord_radius_share(cords: int) -> float:
    """Radius of each of `cords` touching round cords over that of the yarn they make."""
    if cords == 1:
        return 1.0
    sine = float(np.sin(np.pi / cords))
    return sine / (1.0 + sine)


def fitted_outer_radius(config: FibersConfig) -> float:
    """Where the preset's plies touch the yarn's surface [mm]: R_ply + e_Y, around which cords may turn."""
    return (config.ply_center_radius_mm + config.ellipse_short_mm) / cord_radius_share(config.cords)


def scaled_plies(config: FibersConfig, yarn_radius: float) -> PlyShape:
    """The plies of a yarn of `yarn_radius` [mm].

    fit_radius is a similarity of the preset: cross-section and pitches grow alike, fibers keep their
    thickness and grow in number with the area, so the packing stays. Setting the plies apart then shrinks the
    ellipses, moves the centers out until each ply touches the yarn's radius, and winds the plies tighter.
    A yarn of cords is made of such yarns, each with its cord's radius.
    """
    shape = _cord_plies(config, yarn_radius * cord_radius_share(config.cords))
    if config.cords == 1:
        return shape
    pitch = config.cord_pitch_mm
    outer = config.ply_center_radius_mm + config.ellipse_short_mm
    return replace(
        shape,
        cord_center_radius=outer * shape.scale / float(np.sin(np.pi / config.cords)),
        cord_pitch=-2.0 * shape.ply_pitch if pitch is None else pitch,
    )


def _cord_plies(config: FibersConfig, radius: float) -> PlyShape:
    """The plies of one cord, or of a yarn that is none."""
    fit = config.scale == "fit_radius"
    outer = config.ply_center_radius_mm + config.ellipse_short_mm
    scale = radius / outer if fit else 1.0
    apart = (config.ply_separation or ("apart" if fit else "as_fitted")) == "apart" and config.plies > 1
    slim = config.apart_ellipse_scale if apart else 1.0
    long, short = config.ellipse_long_mm * scale * slim, config.ellipse_short_mm * scale * slim
    count = config.fiber_count_scale or (scale * slim) ** 2
    return PlyShape(
        center_radius=outer * scale - short if apart else config.ply_center_radius_mm * scale,
        long=long,
        short=short,
        ply_pitch=config.ply_pitch_mm * scale * (config.apart_ply_pitch_scale if apart else 1.0),
        fiber_pitch=config.fiber_pitch_mm * scale,
        fibers_per_ply=max(round(config.fibers_per_ply * count), 1),
        scale=scale,
    )


def ply_phase(seed: int, yarn: np.ndarray) -> np.ndarray:
    """Angle of the first ply where the yarn begins [turns], a function of (seed, yarn)."""
    return uniform(pcg4d(seed + PURPOSE_PLY_PHASE, yarn, 0, 0)[0])


def cord_phase(seed: int, yarn: np.ndarray) -> np.ndarray:
    """Angle of the first cord where the yarn begins [turns], a function of (seed, yarn)."""
    return uniform(pcg4d(seed + PURPOSE_PLY_PHASE, yarn, 0, 1)[0])


def turns_along(length: float, pitch: float, *, closed: bool) -> float:
    """Turns of a helix of signed `pitch` over a yarn [mm]; whole on a closed yarn, so that its ends meet."""
    turns = length / pitch if pitch != 0 else 0.0
    return float(np.round(turns)) if closed else turns


def phase_at_nodes(turns: float, intervals: int) -> np.ndarray:
    """Phase in [0, 1) turns at the intervals + 1 nodes of a yarn with `turns` in all, float64.

    The whole turns are dropped node by node, so a yarn of any length keeps an error of some 1e-12 turns;
    where `turns` is whole, the last node gets exactly the first one's phase.
    """
    phase = np.arange(intervals + 1) * (turns / intervals)
    phase -= np.floor(phase)
    if turns == np.round(turns):
        phase[-1] = phase[0]
    return phase


def place_in_ply(x: np.ndarray, y: np.ndarray, ply_turns: np.ndarray, shape: PlyShape) -> np.ndarray:
    """Offset from the yarn's center [mm] in its frame (normal, binormal), shape [..., 2].

    (x, y) in the unit disc, x along the short axis (outward), y along the long one; `ply_turns` is the ply's
    angle.
    """
    outward = shape.center_radius + shape.short * x
    sideways = shape.long * y
    c, s = np.cos(2.0 * np.pi * ply_turns), np.sin(2.0 * np.pi * ply_turns)
    return np.stack([c * outward - s * sideways, s * outward + c * sideways], axis=-1)


def place_in_cord(
    x: np.ndarray, y: np.ndarray, ply_turns: np.ndarray, cord_turns: np.ndarray, shape: PlyShape
) -> np.ndarray:
    """The same for a ply of a cord; `cord_turns` is the cord's angle, against which the ply's is measured."""
    along, across = np.moveaxis(place_in_ply(x, y, ply_turns, shape), -1, 0)
    along = along + shape.cord_center_radius
    c, s = np.cos(2.0 * np.pi * cord_turns), np.sin(2.0 * np.pi * cord_turns)
    return np.stack([c * along - s * across, s * along + c * across], axis=-1)
