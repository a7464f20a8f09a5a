"""The pictures of renderer/README.md, each from its job: python -m tests.renderer.pictures FOLDER [FACTOR].

FACTOR multiplies the samples per pixel that the jobs ask for; names of pictures may follow. What jobs need
and the project does not ship, a measured table and a mesh, is written first.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from PIL import Image

from weft.pipeline.cli import exit_code

from .merl_models import gold_paint, write_model

JOBS = Path(__file__).parent / "jobs"
PICTURES = {
    "disney_sweep": ("disney_sweep",),
    "merl_material": ("merl_material",),
    "hexagonal_bokeh": ("hexagonal_bokeh",),
    "two_environments": ("swatch_studio", "swatch_daylight"),
    "twill_and_mirror": ("twill", "twill_mirrored"),
    "all_lights": ("all_lights",),
}
"""Jobs whose pictures stand side by side."""
GAP_PIXELS = 4


def write_inputs() -> None:
    """The table and the mesh that jobs name."""
    import trimesh

    for name in ("merl_material", "all_lights"):
        (JOBS / f"{name}.out").mkdir(exist_ok=True)
    write_model(JOBS / "merl_material.out", "gold_paint", gold_paint())
    ring = trimesh.creation.torus(major_radius=2.6, minor_radius=0.35, major_sections=24, minor_sections=8)
    ring.export(JOBS / "all_lights.out" / "ring.ply")


def render(job: str, factor: float) -> Path:
    """The picture of a job, with `factor` times its samples."""
    import tomllib

    file = JOBS / f"{job}.toml"
    samples = tomllib.loads(file.read_text())["render"]["samples_per_pixel"]
    code = exit_code(
        ["run", str(file), "--set", f"render.samples_per_pixel={max(2, round(samples * factor))}"]
    )
    if code:
        sys.exit(code)
    return JOBS / f"{job}.out" / "image.png"


def side_by_side(files: list[Path]) -> Image.Image:
    parts = [np.asarray(Image.open(file).convert("RGB")) for file in files]
    gap = np.full((len(parts[0]), GAP_PIXELS, 3), 255, np.uint8)
    return Image.fromarray(np.concatenate([p for part in parts for p in (gap, part)][1:], axis=1))


def make_pictures(folder: Path, factor: float, names: list[str]) -> None:
    write_inputs()
    for name in names or list(PICTURES):
        side_by_side([render(job, factor) for job in PICTURES[name]]).save(folder / f"{name}.png")


if __name__ == "__main__":
    scale = float(sys.argv[2]) if len(sys.argv) > 2 else 1.0
    make_pictures(Path(sys.argv[1]), scale, sys.argv[3:])
