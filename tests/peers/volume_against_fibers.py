"""The table and the picture of renderer/VOLUME_AGAINST_FIBERS.md (six minutes of one core).

python -m tests.peers.volume_against_fibers renderer/pictures
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.peers.fiber_scenes import GRAY, bundle, light_from_both_sides, rays_from_above, yarn
from tests.peers.fiber_tracer import FiberScene, FiberTracer
from weft.renderer.config import ConstantLight, EnvironmentLight, OrthographicCamera, RenderConfig
from weft.renderer.image import write_exr
from weft.renderer.render import run
from weft.voxelize.config import VoxelizeConfig
from weft.voxelize.grid import FiberVolume
from weft.voxelize.voxelize import voxelize_segments

VOXELS_MM = (0.015, 0.03, 0.06, 0.12)
KINDS = {
    "as it is": {},
    "fibers": {"correlation": "fibers"},
    "offset 3.5": {"self_shadow_offset_fibers": 3.5},
}
PICTURE = (96, 64)


@dataclass(frozen=True)
class Case:
    name: str
    scene: FiberScene
    half: tuple[float, float]


def cases() -> list[Case]:
    return [
        Case("yarn, 1.4 mm thick, as generated", yarn(radius=0.7), (0.5, 0.75)),
        Case("the same, every tenth fiber", yarn(radius=0.7, keep_one_in=10), (0.5, 0.75)),
        Case("bundle, 45 % fiber, none overlap", bundle(200, seed=6, apart=0.016), (0.1, 0.1)),
        Case("bundle, 45 % fiber, at random", bundle(200, seed=6), (0.1, 0.1)),
        Case("bundle, 89 % fiber, at random", bundle(400, seed=6), (0.1, 0.1)),
        Case("bundle, 7 % fiber, at random", bundle(30, seed=6), (0.1, 0.1)),
    ]


def front_light(folder: Path) -> EnvironmentLight:
    picture = np.zeros((2, 4, 3), np.float32)
    picture[:, 1:3] = 1
    path = folder / "front.exr"
    write_exr(path, {name: picture[..., k] for k, name in enumerate("RGB")}, {})
    return EnvironmentLight(file=path)


def traced(case: Case, count: int = 120_000) -> tuple[np.ndarray, np.ndarray]:
    """Means under both lights, and their relative standard errors."""
    rng = np.random.default_rng(7)
    origin, direction = rays_from_above(count, case.half, rng)
    brought, _, _ = FiberTracer(case.scene).radiance(origin, direction, GRAY, light_from_both_sides, rng)
    mean = brought.mean(axis=0)
    return mean, brought.std(axis=0) / np.sqrt(count) / mean


def voxelized(scene: FiberScene, voxel_mm: float) -> FiberVolume:
    config = VoxelizeConfig(voxel_size_mm=voxel_mm)
    return voxelize_segments(config, scene.segments, fiber_radius_mm=scene.radius_mm)


def rendered(volume: FiberVolume, half: tuple[float, float], light, resolution, samples: int, **settings):
    config = RenderConfig(
        resolution=resolution,
        samples_per_pixel=samples,
        max_bounces=100_000,
        camera=OrthographicCamera(position_mm=(0, 0, 2), target_mm=(0, 0, 0), frame_width_mm=2 * half[0]),
        lights=[light],
        **settings,
    )
    return run(config, volume, {"fiber": GRAY}).radiance[..., 0]


def print_table(lights: list) -> None:
    print("| fibers | voxels [mm] | " + " | ".join(KINDS) + " |")
    print("|---|---|" + "---|" * len(KINDS))
    for case in cases():
        truth, error = traced(case)
        print(f"| {case.name}: {truth[0]:.3f}, {truth[1]:.3f} (to {100 * error.max():.1f} %) | | | | |")
        for voxel in VOXELS_MM:
            volume = voxelized(case.scene, voxel)
            shape = (32, round(32 * case.half[1] / case.half[0]))
            cells = []
            for settings in KINDS.values():
                means = [rendered(volume, case.half, light, shape, 48, **settings).mean() for light in lights]
                cells.append(
                    ", ".join(f"{100 * (m / t - 1):+.1f}" for m, t in zip(means, truth, strict=True))
                )
            print(f"| | {voxel} | " + " | ".join(cells) + " |", flush=True)


def traced_picture(case: Case, samples: int) -> np.ndarray:
    width, height = PICTURE
    rng = np.random.default_rng(9)
    tracer, total = FiberTracer(case.scene), np.zeros(width * height)
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    for _ in range(samples):
        place = np.stack([x, y], axis=-1).reshape(-1, 2) + rng.random((width * height, 2))
        origin = np.full((width * height, 3), 2.0)
        origin[:, 0] = (2 * place[:, 0] / width - 1) * case.half[0]
        origin[:, 1] = (1 - 2 * place[:, 1] / height) * case.half[0] * height / width
        direction = np.tile([0.0, 0.0, -1.0], (width * height, 1))
        total += tracer.radiance(origin, direction, GRAY, light_from_both_sides, rng)[0][:, 1]
    return (total / samples).reshape(height, width)


def draw(folder: Path, light, *, samples: int = 26) -> None:
    """Rows: all, every tenth fiber. Columns: traced; voxels of 0.03 mm, plain and correlated; 0.12 mm."""
    from PIL import Image

    rows = []
    for keep in (1, 10):
        case = Case("", yarn(radius=0.5, keep_one_in=keep), (0.6, 0.4))
        shown = [traced_picture(case, samples)]
        for voxel, kind in ((0.03, "as it is"), (0.03, "fibers"), (0.12, "fibers")):
            volume = voxelized(case.scene, voxel)
            shown.append(rendered(volume, case.half, light, PICTURE, samples, **KINDS[kind]))
        rows.append(np.concatenate(shown, axis=1) * 1.5)
    picture = np.clip(np.concatenate(rows, axis=0), 0, 1) ** (1 / 2.2)
    Image.fromarray((255 * picture).astype(np.uint8)).save(folder / "volume_against_fibers.png")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as temporary:
        front = front_light(Path(temporary))
        print_table([ConstantLight(), front])
        if len(sys.argv) > 1:
            draw(Path(sys.argv[1]), front)
