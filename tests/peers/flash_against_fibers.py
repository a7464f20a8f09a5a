"""Yarns in light from within 18 degrees of the camera, traced and as volumes (a minute of one core).

python -m tests.peers.flash_against_fibers
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from tests.peers.fiber_scenes import GRAY, rays_from_above
from tests.peers.fiber_tracer import FiberTracer
from tests.peers.volume_against_fibers import KINDS, VOXELS_MM, Case, cases, rendered, voxelized
from weft.renderer.config import EnvironmentLight
from weft.renderer.image import write_exr

COSINE = 0.95
ROWS = 256


def cap_light(folder: Path) -> EnvironmentLight:
    """Radiance 1 within the cone around +z, the middle of the picture; cut texels are made up for."""
    theta = (np.arange(ROWS) + 0.5) / ROWS * np.pi - np.pi / 2
    phi = (np.arange(2 * ROWS) + 0.5) / ROWS * np.pi - np.pi
    lit = np.cos(theta)[:, None] * np.cos(phi) > COSINE
    solid_angle = (np.cos(theta)[:, None] * lit).sum() * (np.pi / ROWS) ** 2
    picture = lit.astype(np.float32) * np.float32(2 * np.pi * (1 - COSINE) / solid_angle)
    path = folder / "cap.exr"
    write_exr(path, dict.fromkeys("RGB", picture), {})
    return EnvironmentLight(file=path)


def cap(directions: np.ndarray) -> np.ndarray:
    return (directions[:, 2:] > COSINE).astype(float)


def traced(case: Case, *, count: int = 120_000, seeds: int = 3) -> tuple[float, float]:
    """The mean and its relative standard error."""
    brought = []
    for seed in range(seeds):
        rng = np.random.default_rng(40 + seed)
        origin, direction = rays_from_above(count, case.half, rng)
        brought.append(FiberTracer(case.scene).radiance(origin, direction, GRAY, cap, rng)[0])
    values = np.concatenate(brought)
    return float(values.mean()), float(values.std() / np.sqrt(len(values)) / values.mean())


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as temporary:
        light = cap_light(Path(temporary))
        for case in cases()[:2]:
            truth, error = traced(case)
            print(f"{case.name}: {truth:.5f} (to {100 * error:.1f} %)", flush=True)
            for voxel_mm in VOXELS_MM:
                volume = voxelized(case.scene, voxel_mm)
                means = [
                    rendered(volume, case.half, light, (32, 48), 48, **KINDS[kind]).mean()
                    for kind in ("as it is", "fibers")
                ]
                print(voxel_mm, ", ".join(f"{100 * (mean / truth - 1):+.1f}" for mean in means), flush=True)
