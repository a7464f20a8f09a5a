"""Fibers for comparing volumes with fibers traced one by one: bundles, and yarns as they are generated."""

from __future__ import annotations

import math
import tomllib

import numpy as np

from tests.conftest import CHECKOUT
from tests.peers.fiber_tracer import FiberScene
from weft.fiber_model.config import FibersConfig
from weft.fiber_model.fiber_curves import export_curves
from weft.fiber_model.fibers import run as make_fibers
from weft.fiber_model.scattering.parameters import FiberScatteringParameters
from weft.fiber_model.yarns.yarns import YarnSet

FIBER_RADIUS_MM = 0.008
PIECE_MM = 0.1

GRAY = FiberScatteringParameters(
    *(math.radians(angle) for angle in (6, 12, 24, 40)),
    (0.04,) * 3,
    0.85,
    color_tt=(0.9,) * 3,
    color_trt=(0.9,) * 3,
)


def bundle(
    count: int, *, seed: int, apart: float = 0.0, size: float = 0.3, length: float = 1.0
) -> FiberScene:
    """Straight parallel fibers along x at random places of a square, axes at least so far `apart` [mm]."""
    rng, place = np.random.default_rng(seed), np.empty((0, 2))
    while len(place) < count:
        candidate = rng.uniform(-size / 2, size / 2, 2)
        if not len(place) or np.linalg.norm(place - candidate, axis=1).min() >= apart:
            place = np.vstack([place, candidate])
    x = np.linspace(-length / 2, length / 2, round(length / PIECE_MM) + 1)
    points = np.empty((count, len(x), 3))
    points[..., 0], points[..., 1:] = x, place[:, None, :]
    pieces = np.stack([points[:, :-1], points[:, 1:]], axis=2).reshape(-1, 2, 3)
    fiber = np.repeat(np.arange(count, dtype=np.int32), len(x) - 1)
    return FiberScene(pieces.astype(np.float32), fiber, FIBER_RADIUS_MM)


def yarn(*, radius: float, keep_one_in: int = 1, length: float = 3.2) -> FiberScene:
    """A straight yarn of cotton2 along x, scaled to `radius`, or every tenth, say, of its fibers."""
    preset = tomllib.loads((CHECKOUT / "configs/presets/fibers/cotton2.toml").read_text(encoding="utf-8"))
    line = np.zeros((12, 3))
    line[:, 0] = np.linspace(-length / 2, length / 2, 12)
    curves = export_curves(
        make_fibers(FibersConfig(**preset, seed=1), YarnSet.checked([line], radius=radius))
    )
    pieces, fiber = [], []
    for number in range(0, curves.curve_count, keep_one_in):
        points = curves.points[curves.offsets[number] : curves.offsets[number + 1]]
        pieces.append(np.stack([points[:-1], points[1:]], axis=1))
        fiber.append(np.full(len(points) - 1, number, np.int32))
    return FiberScene(np.concatenate(pieces), np.concatenate(fiber), float(preset["fiber_radius_mm"]))


def rays_from_above(
    count: int, half: float | tuple[float, float], rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Parallel rays against z over a rectangle around the origin, of half the width and height [mm]."""
    origin = np.full((count, 3), 2.0)
    origin[:, :2] = rng.uniform(-1, 1, (count, 2)) * half
    return origin, np.tile([0.0, 0.0, -1.0], (count, 1))


def uniform_light(directions: np.ndarray) -> np.ndarray:
    return np.ones((len(directions), 1))


def light_from_both_sides(directions: np.ndarray) -> np.ndarray:
    """Uniform light, and that of the half around the camera (z > 0) alone."""
    return np.stack([np.ones(len(directions)), directions[:, 2] > 0], axis=1).astype(float)
