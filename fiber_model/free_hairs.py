"""Hairs that leave the yarn's coordinates: some wander at random, some hang down. Not in Zhao et al. 2016.

Both begin within a ply, at `ROOT` of its radius, at a place as random as a hair's of equation 11, in a
direction with the density cos(angle) / pi around the way out of the ply. Lengths are normals above 0.
Counts are Poisson, drawn stretch by stretch.

Walk: straight steps of one hair's length / segments. Each step turns by an angle a with cos a = 2 u^q - 1,
u uniform, q = tanh(step / (2 persistence)), around a random axis across; the mean of cos a is then
exp(-step / persistence), exactly, so that the mean cosine between directions a distance d apart is exp(-d /
persistence), whatever the step: the wormlike chain of Kratky and Porod 1949.

Droop: the direction's angle p to the vertical falls as dp/ds = -sin p / bend, so tan(p / 2) falls as exp(-s
/ bend). With T = tan(p / 2), the hair goes s + bend ln((1 + T^2) / (1 + T_0^2)) down and bend (p_0 - p)
sideways. A hair of that kind has unit speed, begins in any direction, and ends hanging; it is a shape, not
the elastica.

Twins in Warp: `free_hair_kernels`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .config import FibersConfig
from .counter_random import (
    PURPOSE_DROOP,
    PURPOSE_DROOP_COUNT,
    PURPOSE_WALK,
    PURPOSE_WALK_COUNT,
    PURPOSE_WALK_STEP,
    REDRAWS,
    normal_pair,
    pcg4d,
    poisson,
    uniform_single,
)

ROOT = 0.8
"""Where a free hair begins, as a part of its ply's radius: inside, so that none floats."""
STEEPEST = 1e-6
"""1 + cosine of the angle to the vertical stays above this: straight up, there is no way to fall."""


@dataclass(frozen=True)
class FreeHairShape:
    """Free hairs of one yarn; lengths [mm]."""

    walk_density: float
    """Per mm of yarn, all plies together; likewise below."""
    walk_length: tuple[float, float]
    """Mean and standard deviation."""
    persistence: float
    droop_density: float
    droop_length: tuple[float, float]
    bend: float
    down: tuple[float, float, float]
    """Unit vector."""


def scaled_free_hairs(config: FibersConfig) -> FreeHairShape:
    """`fuzz` multiplies number and length; lengths are millimeters whatever the yarn's size."""
    walk, droop = config.walk_hairs, config.droop_hairs
    number = config.fuzz * config.cords * config.plies
    longer = config.fuzz if config.fuzz_length is None else config.fuzz_length
    down = np.array(droop.down if droop else (0.0, -1.0, 0.0))
    x, y, z = (down / np.linalg.norm(down)).tolist()
    return FreeHairShape(
        walk_density=number * walk.density_per_mm if walk else 0.0,
        walk_length=(longer * walk.length_mm, longer * walk.length_sd_mm) if walk else (0.0, 0.0),
        persistence=walk.persistence_mm if walk else 1.0,
        droop_density=number * droop.density_per_mm if droop else 0.0,
        droop_length=(longer * droop.length_mm, longer * droop.length_sd_mm) if droop else (0.0, 0.0),
        bend=droop.bend_mm if droop else 1.0,
        down=(x, y, z),
    )


def free_hair_counts(
    seed: int, yarn: np.ndarray, stretch: np.ndarray, walks: np.ndarray, droops: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Walking and drooping hairs that begin in each stretch, Poisson with those means."""
    return (
        poisson(walks, seed + PURPOSE_WALK_COUNT, yarn, stretch),
        poisson(droops, seed + PURPOSE_DROOP_COUNT, yarn, stretch),
    )


@dataclass(frozen=True)
class FreeHairs:
    """Free hairs before they are placed, float32, one entry per hair."""

    ply: np.ndarray
    start: np.ndarray
    """Where it begins, as a part of its stretch."""
    angle: np.ndarray
    """Around its ply [turns]."""
    toward: np.ndarray
    """Uniform on the unit sphere, shape [hair_count, 3]; added to the way out they give the direction."""
    length: np.ndarray
    """[mm]"""


def sample_free_hairs(
    purpose: int,
    seed: int,
    yarn: int,
    stretch: np.ndarray,
    hair: np.ndarray,
    plies: int,
    length: tuple[float, float],
) -> FreeHairs:
    """Free hair number `hair` of a stretch, of the kind of `PURPOSE_WALK` or `PURPOSE_DROOP`."""
    place = pcg4d(seed + purpose, yarn, stretch, hair)
    words = pcg4d(seed + purpose + 1, yarn, stretch, hair)
    height = np.float32(2.0) * uniform_single(words[0]) - np.float32(1.0)
    around = np.float32(2.0 * np.pi) * uniform_single(words[1])
    across = np.sqrt(np.maximum(np.float32(1.0) - height * height, np.float32(0.0)))
    drawn = np.zeros(hair.shape, dtype=np.float32)
    for draw in range(REDRAWS):
        word = pcg4d(seed + purpose + 2 + draw, yarn, stretch, hair)
        value = np.float32(length[0]) + np.float32(length[1]) * normal_pair(word[2], word[3])[0]
        drawn = np.where(drawn <= 0, value, drawn)
    return FreeHairs(
        ply=np.minimum((uniform_single(place[2]) * np.float32(plies)).astype(np.int32), plies - 1),
        start=uniform_single(place[0]),
        angle=uniform_single(place[1]),
        toward=np.stack([across * np.cos(around), across * np.sin(around), height], axis=-1),
        length=np.maximum(drawn, np.float32(0.0)),
    )


def leaving_direction(outward: np.ndarray, toward: np.ndarray) -> np.ndarray:
    """Unit vectors with density cos / pi around unit `outward`, from uniform unit vectors; shape [..., 3]."""
    total = outward + toward
    size = np.linalg.norm(total, axis=-1, keepdims=True)
    return np.where(size > 1e-4, total / np.maximum(size, 1e-4), outward)


def walk_points(
    seed: int,
    yarn: int,
    stretch: np.ndarray,
    hair: np.ndarray,
    root: np.ndarray,
    direction: np.ndarray,
    length: np.ndarray,
    *,
    persistence: float,
    segments: int,
) -> np.ndarray:
    """Points of walking hairs [mm], float64, shape [hair_count, segments + 1, 3]."""
    step = np.asarray(length, dtype=np.float64) / segments
    power = np.tanh(0.5 * step / persistence)
    points = [np.asarray(root, dtype=np.float64)]
    for k in range(segments):
        points.append(points[-1] + step[:, None] * direction)
        words = pcg4d(seed + PURPOSE_WALK_STEP, yarn, stretch, hair * 256 + k)
        cosine = 2.0 * uniform_single(words[0]).astype(np.float64) ** power - 1.0
        around = 2.0 * np.pi * uniform_single(words[1])
        first, second = _across(direction)
        sideways = np.cos(around)[:, None] * first + np.sin(around)[:, None] * second
        sine = np.sqrt(np.maximum(1.0 - cosine**2, 0.0))
        direction = cosine[:, None] * direction + sine[:, None] * sideways
        direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    return np.stack(points, axis=1)


def _across(direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors across each direction, from the coordinate axis y, or x where that is near."""
    axis = np.where(np.abs(direction[:, 1:2]) < 0.8, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]])
    first = np.cross(axis, direction)
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    return first, np.cross(direction, first)


def droop_points(
    root: np.ndarray, direction: np.ndarray, length: np.ndarray, shape: FreeHairShape, *, segments: int
) -> np.ndarray:
    """Points of drooping hairs [mm], float64, shape [hair_count, segments + 1, 3]."""
    down = np.asarray(shape.down)
    cosine = np.maximum(direction @ down, -1.0 + STEEPEST)
    sideways = direction - (direction @ down)[:, None] * down
    size = np.linalg.norm(sideways, axis=-1, keepdims=True)
    # straight up, any way to fall will do
    sideways = np.where(size > 1e-4, sideways / np.maximum(size, 1e-4), _across(down[None])[0])
    begin = np.sqrt(np.maximum(1.0 - cosine, 0.0) / (1.0 + cosine))[:, None]
    s = np.asarray(length, dtype=np.float64)[:, None] * np.linspace(0.0, 1.0, segments + 1)
    now = begin * np.exp(-s / shape.bend)
    fallen = s + shape.bend * np.log((1.0 + now**2) / (1.0 + begin**2))
    gone = 2.0 * shape.bend * (np.arctan(begin) - np.arctan(now))
    return root[:, None] + fallen[..., None] * down + gone[..., None] * sideways[:, None]


KINDS = {"walk": PURPOSE_WALK, "droop": PURPOSE_DROOP}
"""Purposes of the random numbers of each kind."""
