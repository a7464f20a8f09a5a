"""Fly-aways: loops and hairs that leave the ply. Zhao, Luan and Bala 2016, section 3.2 and equation 11.

Loop: over one migration period a fiber's peak R_max R_i becomes R_loop ~ Normal, larger than its own; the
period's ends stay in the ply. The paper picks rho_loop fibers per length; here each period of each fiber is a
loop with probability rho_loop * period / m, which is the same density and needs to know nothing of other
places.

Hair: an arc of its own. With t in [0, 1] it runs through R = R_min + R_span t, theta = theta_min + theta_span
t, z = z_min + z_span t around the ply center; R_min, R_span, theta_span, z_span are independent normals,
theta_min is uniform, and z_min is a Poisson process of density rho_hair along each ply, drawn stretch by
stretch.

Distances are measured in sqrt(e_X e_Y), so that they refer to the unit disc before it is stretched to the
ellipse. Truncations: R_loop above the fiber's own peak, R_min at least 0, R_span above 0, each by drawing
again. Twins in Warp: `body_kernels.loop_peak`, `hair_kernels.open_arc`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .config import FibersConfig
from .counter_random import (
    LARGEST_NORMAL,
    PURPOSE_HAIR_COUNT,
    PURPOSE_HAIR_PLACE,
    PURPOSE_HAIR_SHAPE,
    PURPOSE_LOOP,
    REDRAWS,
    normal_pair,
    pcg4d,
    poisson,
    uniform_single,
)
from .plies import PlyShape


@dataclass(frozen=True)
class FlyawayShape:
    """Normals of the fly-aways of one yarn: means and standard deviations, distances in sqrt(e_X e_Y)."""

    loop_probability: float
    """Of one migration period of one fiber being a loop, in [0, 1]."""
    loop_demand: float
    """The same before it was cut at 1: above 1 there are fewer periods than loops asked for."""
    loop_radius: tuple[float, float]
    hair_density: float
    """Hairs per mm of yarn, all plies together."""
    hair_radius: tuple[float, float]
    hair_radius_span: tuple[float, float]
    hair_angle_span: tuple[float, float]
    """[rad]"""
    hair_z_span: tuple[float, float]
    """[mm]"""
    hair_root_limit: float
    """Largest R_min: 1 where hairs must begin inside their ply."""

    @property
    def loop_reach(self) -> float:
        """No loop goes farther from the ply center than this."""
        return self.loop_radius[0] + LARGEST_NORMAL * self.loop_radius[1] if self.loop_probability else 0.0


def scaled_flyaways(config: FibersConfig, plies: PlyShape, period: float) -> FlyawayShape:
    """The fly-aways of a yarn whose plies are `plies` and whose migration period is `period` [mm].

    With fit_radius, distances grow with the ply and lengths along the yarn with the yarn; the number per mm
    of ply stays as fitted. `fuzz` multiplies that number and the length: of a hair its extent along the yarn
    and away from the ply, of a loop what its peak stands off the ply's border.
    """
    size = np.sqrt(config.ellipse_long_mm * config.ellipse_short_mm)
    sd = config.flyaway_sd_factor
    demand = config.fuzz * config.loop_density_per_mm * period / plies.fibers_per_ply
    longer = config.fuzz if config.fuzz_length is None else config.fuzz_length
    reach, along = longer / size, longer * plies.scale
    loop = config.loop_radius_mm / size
    return FlyawayShape(
        loop_probability=min(demand, 1.0),
        loop_demand=demand,
        # written so that a factor of 1 changes no bit
        loop_radius=(
            loop + max(loop - 1.0, 0.0) * (longer - 1.0),
            sd * config.loop_radius_sd_mm / size * longer,
        ),
        hair_density=config.fuzz * config.hair_density_per_mm * (config.cords * config.plies),
        hair_radius=(config.hair_radius_mm / size, sd * config.hair_radius_sd_mm / size),
        hair_radius_span=(config.hair_radius_span_mm * reach, sd * config.hair_radius_span_sd_mm * reach),
        hair_angle_span=_radians(config.hair_angle_span_deg, sd * config.hair_angle_span_sd_deg),
        hair_z_span=(config.hair_z_span_mm * along, sd * config.hair_z_span_sd_mm * along),
        hair_root_limit=1.0 if config.hair_root_inside else np.inf,
    )


def probability_threshold(probability: float) -> int:
    """A 32-bit word is at most this with that probability (0 is told apart elsewhere)."""
    return min(round(probability * 2.0**32), 2**32 - 1)


def is_loop(seed: int, yarn: int, fiber: np.ndarray, period: np.ndarray, probability: float) -> np.ndarray:
    """Whether a migration period of a fiber is a loop."""
    word = pcg4d(seed + PURPOSE_LOOP, yarn, fiber, period)[0]
    return (
        word <= np.uint32(probability_threshold(probability))
        if probability > 0
        else np.zeros(word.shape, bool)
    )


def loop_peak(
    seed: int, yarn: int, fiber: np.ndarray, period: np.ndarray, own: np.ndarray, radius: tuple[float, float]
) -> np.ndarray:
    """R_loop of loops, float32: normals above the fibers' `own` peaks, which stay after `REDRAWS` draws."""
    fiber, period, own = np.broadcast_arrays(fiber, period, np.asarray(own, dtype=np.float32))
    peak, waiting = own.copy(), np.ones(own.shape, bool)
    for draw in range(1, REDRAWS + 1):
        key = (seed + PURPOSE_LOOP + draw, yarn, fiber, period)
        word = pcg4d(*key)
        drawn = np.float32(radius[0]) + np.float32(radius[1]) * normal_pair(word[1], word[2])[0]
        accepted = waiting & (drawn > own)
        peak[accepted] = drawn[accepted]
        waiting &= ~accepted
    return peak


def hair_counts(seed: int, yarn: np.ndarray, stretch: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """Hairs that begin in each stretch, Poisson with that mean; a function of (seed, yarn, stretch)."""
    return poisson(mean, seed + PURPOSE_HAIR_COUNT, yarn, stretch)


@dataclass(frozen=True)
class Hairs:
    """Shapes of hairs, float32 arrays of one entry per hair; distances in sqrt(e_X e_Y)."""

    ply: np.ndarray
    start: np.ndarray
    """Where it begins, as a part of its stretch, in (0, 1)."""
    angle: np.ndarray
    """theta_min [turns]."""
    radius: np.ndarray
    radius_span: np.ndarray
    angle_span: np.ndarray
    """[rad]"""
    z_span: np.ndarray
    """[mm]"""


def sample_hairs(
    seed: int, yarn: int, stretch: np.ndarray, hair: np.ndarray, plies: int, shape: FlyawayShape
) -> Hairs:
    """Hair number `hair` of stretch number `stretch` of a yarn, a function of (seed, yarn, stretch, hair)."""
    place = pcg4d(seed + PURPOSE_HAIR_PLACE, yarn, stretch, hair)
    spans = pcg4d(seed + PURPOSE_HAIR_SHAPE, yarn, stretch, hair)
    angle_normal, z_normal = normal_pair(spans[0], spans[1])
    radius = np.full(hair.shape, np.nan, dtype=np.float32)
    radius_span = radius.copy()
    for draw in range(1, REDRAWS + 1):
        word = pcg4d(seed + PURPOSE_HAIR_SHAPE + draw, yarn, stretch, hair)
        low, span = normal_pair(word[0], word[1])
        low = np.float32(shape.hair_radius[0]) + np.float32(shape.hair_radius[1]) * low
        span = np.float32(shape.hair_radius_span[0]) + np.float32(shape.hair_radius_span[1]) * span
        radius = np.where(np.isnan(radius) & (low >= 0), low, radius)
        radius_span = np.where(np.isnan(radius_span) & (span > 0), span, radius_span)
    return Hairs(
        ply=np.minimum((uniform_single(place[2]) * np.float32(plies)).astype(np.int32), plies - 1),
        start=uniform_single(place[0]),
        angle=uniform_single(place[1]),
        radius=np.minimum(np.nan_to_num(radius), np.float32(shape.hair_root_limit)),
        radius_span=np.nan_to_num(radius_span),
        angle_span=np.float32(shape.hair_angle_span[0]) + np.float32(shape.hair_angle_span[1]) * angle_normal,
        z_span=np.float32(shape.hair_z_span[0]) + np.float32(shape.hair_z_span[1]) * z_normal,
    )


def _radians(mean_deg: float, sd_deg: float) -> tuple[float, float]:
    return float(np.radians(mean_deg)), float(np.radians(sd_deg))
