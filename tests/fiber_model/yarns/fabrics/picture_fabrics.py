"""Draws every named weave and knit as tubes on one sheet, fiber_model/yarns/pictures/fabrics.png.

.venv/bin/python -m tests.fiber_model.yarns.fabrics.picture_fabrics
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import get_args

import numpy as np

from weft.fiber_model.yarns.build import run
from weft.fiber_model.yarns.config import ChartName, DraftName, KnitConfig, WeaveConfig
from weft.fiber_model.yarns.frames import build_frames
from weft.fiber_model.yarns.yarns import YarnSet

SHEET = Path(__file__).parents[4] / "fiber_model" / "yarns" / "pictures" / "fabrics.png"
COLUMNS, PANEL = 6, 300
WARP, WEFT = "#38537a", "#e2d7bf"
COURSES = ("#c9a46c", "#8d4a3a")
CABLES = "#d9cdb4"


def weaves() -> dict[str, YarnSet]:
    """Plain and basket weave square; the others with twice as many warps, so that these can be dense."""
    cloth = {}
    for name in get_args(DraftName):
        warp, weft = (13.0, 13.0) if name in ("plain", "basket_2_2") else (22.0, 11.4)
        size = 15.0 if name.startswith("herringbone") else 9.0
        config = WeaveConfig(
            kind="weave",
            size_mm=(size, size),
            draft=name,
            warp_per_cm=warp,
            weft_per_cm=weft,
            type_names=["warp", "weft"],
        )
        cloth[name] = run(config)
    return cloth


def knits() -> dict[str, YarnSet]:
    """Stitches 4 mm wide; of cables a little more than one repeat."""
    cloth = {}
    for name in get_args(ChartName):
        size = (28.8, 28.8) if name.startswith("cable") else (20.0, 20.0)
        cloth[name] = run(KnitConfig(kind="knit", size_mm=size, chart=name, stitch_width_mm=4.0))
    return cloth


def draw(yarns: YarnSet, name: str, view: tuple[float, float, float]) -> np.ndarray:
    """One panel, 8-bit RGB: the cloth as tubes under parallel light, with its name."""
    import pyvista

    plotter = pyvista.Plotter(off_screen=True, window_size=(PANEL, PANEL))
    plotter.enable_anti_aliasing("ssaa")
    plotter.set_background("white")
    frames = build_frames(yarns)
    for yarn in range(yarns.yarn_count):
        points = frames.position[frames.offsets[yarn] : frames.offsets[yarn + 1]]
        tube = pyvista.lines_from_points(points).tube(radius=yarns.radius[yarn], n_sides=16, capping=True)
        color = COURSES[yarn % 2]
        if name in get_args(DraftName):
            color = (WARP, WEFT)[yarns.yarn_type[yarn]]
        elif name.startswith("cable"):
            color = CABLES
        plotter.add_mesh(tube, color=color, smooth_shading=True, ambient=0.15, specular=0.1)
    plotter.view_vector(view, viewup=(0, 1, 0))
    plotter.enable_parallel_projection()
    low, high = yarns.bounds
    plotter.camera.parallel_scale = 0.56 * float((high - low)[:2].max())
    plotter.add_text(name, font_size=8, color="black", position=(6, PANEL - 20))
    picture = plotter.screenshot(return_img=True)
    plotter.close()
    return np.asarray(picture)


def main() -> None:
    """Write the sheet, as a picture of 256 colors."""
    os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    from PIL import Image

    cloth = {**weaves(), **knits()}
    panels = [draw(yarns, name, (0.0, -0.15, 1.0)) for name, yarns in cloth.items()]
    panels += [np.full_like(panels[0], 255)] * (-len(panels) % COLUMNS)
    rows = [np.concatenate(panels[k : k + COLUMNS], axis=1) for k in range(0, len(panels), COLUMNS)]
    SHEET.parent.mkdir(exist_ok=True)
    Image.fromarray(np.concatenate(rows)).quantize(256).save(SHEET, optimize=True)


if __name__ == "__main__":
    main()
