"""Small volumes and fibers for the tests of this room."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from weft.voxelize.grid import BRICK_VOXELS, FiberGrid, FiberVolume

COTTON = {
    "plies": 3,
    "fibers_per_ply": 12,
    "fiber_radius_mm": 0.01,
    "ply_pitch_mm": 3.0,
    "fiber_pitch_mm": -4.0,
    "ply_center_radius_mm": 0.2,
    "ellipse_long_mm": 0.2,
    "ellipse_short_mm": 0.15,
    "cross_section_epsilon": 0.05,
    "cross_section_beta": 0.3,
    "migration_per_turn": 1.5,
    "migration_min": 0.8,
    "hair_density_per_mm": 4.0,
    "hair_z_span_mm": 0.3,
    "hair_z_span_sd_mm": 0.3,
    "hair_radius_mm": 0.1,
    "hair_radius_sd_mm": 0.02,
    "hair_radius_span_mm": 0.2,
    "hair_radius_span_sd_mm": 0.1,
    "hair_angle_span_deg": 20.0,
    "hair_angle_span_sd_deg": 20.0,
    "loop_density_per_mm": 2.0,
    "loop_radius_mm": 0.25,
    "loop_radius_sd_mm": 0.05,
    "scale": "as_fitted",
}


def random_grid(seed: int, brick_count: int, *, fill: float = 0.5) -> FiberGrid:
    """Bricks at random places with random densities in a part `fill` of their voxels."""
    rng = np.random.default_rng(seed)
    places = np.unique(rng.integers(-40, 40, (brick_count, 3)), axis=0)
    origins = (places * 8).astype(np.int32)
    density = rng.uniform(0.01, 1.5, (len(origins), BRICK_VOXELS)).astype(np.float32)
    density[rng.random(density.shape) > fill] = 0
    direction = rng.normal(size=(*density.shape, 3))
    direction /= np.linalg.norm(direction, axis=2, keepdims=True)
    direction *= np.where(direction[..., 2:] < 0, -1, 1)
    direction[density == 0] = 0
    return FiberGrid(0.06, 0.008, origins, density, direction.astype(np.float32))


@pytest.fixture
def make_grid() -> Callable[..., FiberGrid]:
    """`random_grid(seed, brick_count)`."""
    return random_grid


@pytest.fixture(params=["one medium", "several media"])
def volume(request: pytest.FixtureRequest) -> FiberVolume:
    """One medium; or three, one of which holds nothing."""
    if request.param == "one medium":
        return FiberVolume({"yarn": random_grid(0, 60)})
    return FiberVolume({"weft": random_grid(1, 20), "warp": random_grid(2, 9), "absent": random_grid(3, 0)})


@pytest.fixture(scope="session")
def fibers():
    """A crossing of two curved yarns of two types, with loops and hairs."""
    from weft.fiber_model.config import FibersConfig
    from weft.fiber_model.fibers import run
    from weft.fiber_model.yarns.yarns import YarnSet

    t = np.linspace(-4, 4, 13)
    warp = np.stack([t, 0.4 * np.cos(t), 0.3 * np.sin(t)], axis=1)
    weft = np.stack([0.3 * np.sin(t), t, 0.5 - 0.3 * np.cos(t)], axis=1)
    yarns = YarnSet(
        points=np.concatenate([warp, weft]),
        offsets=np.array([0, 13, 26]),
        closed=np.array([False, False]),
        radius=np.array([0.4, 0.4]),
        yarn_type=np.array([0, 1], dtype=np.int32),
        type_names=("warp", "weft"),
    )
    return run(FibersConfig(**COTTON, by_type={"weft": {"fiber_radius_mm": 0.015}}), yarns)
