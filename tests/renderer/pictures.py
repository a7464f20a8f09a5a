"""The sweep of materials in renderer/README.md: python -m tests.renderer.pictures renderer/pictures."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from weft.renderer.config import ConstantLight, PerspectiveCamera, RenderConfig
from weft.renderer.image import write_preview
from weft.renderer.light_config import QuadLight
from weft.renderer.render import run
from weft.renderer.scene import IsotropicPhase
from weft.renderer.surface_config import GroundSurface, MeshSurface, Placement, PrincipledMaterial

from .meshes import write_ball
from .volumes import uniform_grid, volume

STEPS = (0.0, 0.25, 0.5, 0.75, 1.0)
ROWS = (
    {"color": (0.6, 0.15, 0.1), "sweep": "roughness"},
    {"color": (0.8, 0.6, 0.3), "metallic": 1.0, "sweep": "roughness"},
    {"color": (0.1, 0.25, 0.6), "roughness": 0.7, "sweep": "sheen"},
    {"color": (0.1, 0.4, 0.2), "roughness": 0.6, "clearcoat_gloss": 0.9, "sweep": "clearcoat"},
)


def materials() -> list[tuple[int, int, PrincipledMaterial]]:
    """Row, column and material of every ball."""
    made = []
    for j, row in enumerate(ROWS):
        fixed = {name: value for name, value in row.items() if name != "sweep"}
        made += [(j, i, PrincipledMaterial(**(fixed | {row["sweep"]: step}))) for i, step in enumerate(STEPS)]
    return made


def sweep(folder: Path, samples: int) -> None:
    with tempfile.TemporaryDirectory() as place:
        ball = write_ball(Path(place), subdivisions=4)
        balls = [
            MeshSurface(file=ball, material=m, placements=[Placement(position_mm=(2.4 * i, 1.4, 2.4 * j))])
            for j, i, m in materials()
        ]
        config = RenderConfig(
            resolution=(240, 180),
            samples_per_pixel=samples,
            max_bounces=8,
            lights=[
                QuadLight(
                    position_mm=(-3, 12, 8),
                    target_mm=(5, 0, 4),
                    width_mm=6,
                    height_mm=5,
                    radiance=(12, 12, 12),
                ),
                ConstantLight(radiance=(0.25, 0.27, 0.3)),
            ],
            surfaces=[*balls, GroundSurface(size_mm=200)],
            camera=PerspectiveCamera(position_mm=(4.8, 13, 22), target_mm=(4.8, 0.5, 3.4), fov_deg=32),
        )
        # a speck of fiber far below the picture: the stage wants a volume
        result = run(config, volume(uniform_grid((1, 1, 1), 0.1, (1, 0, 0))), {"a": IsotropicPhase()})
        write_preview(folder / "materials.png", result.radiance, exposure=0.2)


if __name__ == "__main__":
    sweep(Path(sys.argv[1]), 96)
