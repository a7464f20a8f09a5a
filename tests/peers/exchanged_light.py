"""How reciprocal each kind of free flights is: light along z seen from the side, over the same exchanged.

python -m tests.peers.exchanged_light
"""

from __future__ import annotations

import dataclasses

import numpy as np

from tests.peers.fiber_scenes import GRAY, bundle
from tests.peers.volume_against_fibers import KINDS, voxelized
from weft.renderer.config import DirectionalLight, OrthographicCamera, RenderConfig
from weft.renderer.render import run

WIDTH_MM = 1.2
"""Of the picture: the whole bundle, from either side."""
RECIPROCAL = dataclasses.replace(GRAY, longitudinal="symmetric")
ALONG_Z = (0.0, 0.0, 1.0)
ASIDE = {53: (0.0, 0.8, 0.6), 90: (0.0, 1.0, 0.0)}
"""By their angle to z [deg]."""
SEEDS = range(4)


def seen(volume, toward_camera, toward_light, seed: int, settings: dict) -> float:
    """Mean radiance of the picture."""
    config = RenderConfig(
        resolution=(64, 64),
        samples_per_pixel=48,
        max_bounces=100_000,
        seed=seed,
        camera=OrthographicCamera(
            position_mm=tuple(2 * np.array(toward_camera)),
            target_mm=(0, 0, 0),
            up=(1, 0, 0),
            frame_width_mm=WIDTH_MM,
        ),
        lights=[DirectionalLight(direction=toward_light)],
        **settings,
    )
    return float(run(config, volume, {"fiber": RECIPROCAL}).radiance[..., 0].mean())


def print_ratios(volume, name: str, settings: dict) -> None:
    for angle, aside in ASIDE.items():
        ratios = [
            seen(volume, aside, ALONG_Z, seed, settings) / seen(volume, ALONG_Z, aside, seed, settings)
            for seed in SEEDS
        ]
        error = np.std(ratios, ddof=1) / np.sqrt(len(ratios))
        print(f"{name}, {angle} degrees: {np.mean(ratios):.3f} ± {error:.3f}", flush=True)


if __name__ == "__main__":
    scene = bundle(200, seed=6)
    for voxel_mm in (0.015, 0.03, 0.06):
        volume = voxelized(scene, voxel_mm)
        for kind, settings in KINDS.items():
            print_ratios(volume, f"{voxel_mm} mm, {kind}", settings)
