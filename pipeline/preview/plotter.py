"""Scenes to a window or a PNG: the only place that loads pyvista."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from weft.files.atomic import atomic_write
from weft.files.errors import InputError

from .scene import Axes, Picture, Scene, Slice, Surface, Triangles, Tubes, View

BACKGROUND, EMPTY, FRAME = "white", (236, 236, 236), (110, 110, 110)
DENSITY_COLORS = "YlOrBr"
FINER = 2
"""Pictures are drawn so many times larger and averaged, since fibers are thinner than pixels. On a processor
this is faster than multisampling."""
LINES_PER_PANEL = 480
"""A thin line is the height of a panel over this."""


def has_display() -> bool:
    """Whether a window can be opened."""
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def write_png(scenes: Sequence[Scene], path: Path, *, size: tuple[int, int], view: View | None) -> None:
    """Draw the panels off screen, side by side."""
    from PIL import Image

    os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    fine = (size[0] * FINER, size[1] * FINER)
    plotter = build_plotter(scenes, size=fine, view=view, off_screen=True)
    try:
        levels = np.asarray(plotter.screenshot(return_img=True))
    finally:
        plotter.close()
    if levels.min() == levels.max():
        raise InputError(
            "the picture came out empty: off-screen drawing does not work here.",
            hint="'weft doctor' says what OpenGL this machine has.",
        )
    with atomic_write(path) as temporary:
        Image.fromarray(levels).reduce(FINER).save(temporary, format="PNG", optimize=True)


def show_window(scenes: Sequence[Scene], *, size: tuple[int, int], view: View | None) -> None:
    """Open a window and return when it is closed."""
    build_plotter(scenes, size=size, view=view, off_screen=False).show(title="weft preview")


def build_plotter(
    scenes: Sequence[Scene], *, size: tuple[int, int], view: View | None, off_screen: bool
) -> Any:
    """A pyvista plotter with one panel for each scene; panels of one kind have one scale."""
    import pyvista

    from .framing import Panel, framed, needed_scale
    from .heading import Heading, font_pixels
    from .overlay import Overlay
    from .scale_bar import ScaleBar

    plotter = pyvista.Plotter(
        shape=(1, len(scenes)), off_screen=off_screen, window_size=list(size), border=False
    )
    plotter.set_background(BACKGROUND)
    width, height = size[0] // len(scenes), size[1]
    line = max(height / LINES_PER_PANEL, 1.0)
    panels: list[Panel] = []
    overlays: list[Overlay] = []
    scales: dict[str, float] = {}
    for column, scene in enumerate(scenes):
        plotter.subplot(0, column)
        overlay = Overlay(plotter.renderer, font_pixels(width, height))
        heading = Heading(plotter.renderer, overlay, scene, width)
        has_bar = any(isinstance(layer, Slice) for layer in scene.layers)
        panel = Panel(width, height, heading.height, has_bar, scene.in_mm)
        scale = needed_scale(scene.bounds, view or scene.view, panel)
        scales[scene.kind] = max(scales.get(scene.kind, 0.0), scale)
        panels.append(panel)
        overlays.append(overlay)
    for column, scene in enumerate(scenes):
        plotter.subplot(0, column)
        for layer in scene.layers:
            DRAWERS[type(layer)](plotter, layer, overlays[column].font_pixels)
        if scene.frame is not None:
            box = pyvista.Box(scene.frame.T.ravel())
            plotter.add_mesh(box, style="wireframe", color=FRAME, line_width=line, lighting=False)
        camera = framed(scene.bounds, view or scene.view, panels[column], scales[scene.kind])
        _place_camera(plotter, camera)
        if scene.in_mm:
            ScaleBar(plotter.renderer, overlays[column])
            plotter.add_axes(line_width=2 * line, viewport=(0.0, 0.0, 0.15, 0.15))
    if not off_screen:
        plotter.enable_anti_aliasing("msaa", multi_samples=4, all_renderers=True)
    return plotter


def _place_camera(plotter: Any, framing: Any) -> None:
    plotter.camera.position = framing.position.tolist()
    plotter.camera.focal_point = framing.focal_point.tolist()
    plotter.camera.up = framing.up.tolist()
    plotter.enable_parallel_projection()
    plotter.camera.parallel_scale = framing.parallel_scale
    plotter.renderer.camera_set = True
    plotter.renderer.ResetCameraClippingRange()


def _draw_tubes(plotter: Any, tubes: Tubes, font: int) -> None:
    from .meshes import tube_mesh

    mesh = tube_mesh(tubes)
    actor = plotter.add_mesh(mesh, scalars="color", rgb=True, specular=0.15, ambient=0.15, culling="back")
    actor.prop.interpolation = "gouraud"  # with the normals that come with the tubes


def _draw_slice(plotter: Any, layer: Slice, font: int) -> None:
    from .meshes import slice_mesh

    plotter.add_mesh(
        slice_mesh(layer),
        scalars="density",
        cmap=DENSITY_COLORS,
        clim=(0.0, layer.top),
        nan_color=EMPTY,
        lighting=False,
        interpolate_before_map=False,
        scalar_bar_args={
            "title": "fiber volume\nfraction",
            "vertical": True,
            "position_x": 0.87,
            "position_y": 0.2,
            "height": 0.5,
            "width": 0.06,
            "title_font_size": font,
            "label_font_size": font,
            "unconstrained_font_size": True,
            "color": "black",
            "fmt": "%.2g",
            "n_labels": 5,
        },
    )


def _draw_axes(plotter: Any, axes: Axes, font: int) -> None:
    from .meshes import axis_sticks

    if len(axes.centers):
        plotter.add_mesh(axis_sticks(axes), scalars="color", rgb=True, lighting=False)


def _draw_surface(plotter: Any, surface: Surface, font: int) -> None:
    from .meshes import level_surface

    plotter.add_mesh(level_surface(surface), color=surface.color, specular=0.1, smooth_shading=True)


def _draw_triangles(plotter: Any, mesh: Triangles, font: int) -> None:
    from .meshes import triangle_mesh

    plotter.add_mesh(triangle_mesh(mesh), color=(205, 205, 210), smooth_shading=False, specular=0.1)


def _draw_picture(plotter: Any, picture: Picture, font: int) -> None:
    from .meshes import picture_mesh

    plotter.add_mesh(picture_mesh(picture), scalars="color", rgb=True, lighting=False)


DRAWERS: dict[type, Callable[[Any, Any, int], None]] = {
    Tubes: _draw_tubes,
    Slice: _draw_slice,
    Axes: _draw_axes,
    Surface: _draw_surface,
    Triangles: _draw_triangles,
    Picture: _draw_picture,
}
