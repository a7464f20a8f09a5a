"""The layers of a scene as pyvista meshes."""

from __future__ import annotations

import numpy as np
import pyvista

from .scene import Axes, Picture, Slice, Surface, Triangles, Tubes

STICK = 0.07
"""Radius of a direction's stick, in its lengths."""


def tube_mesh(tubes: Tubes) -> pyvista.PolyData:
    """Round tubes with capped ends."""
    counts = np.diff(tubes.offsets)
    cells = np.insert(np.arange(len(tubes.points)), tubes.offsets[:-1], counts)
    lines = pyvista.PolyData(tubes.points, lines=cells)
    lines.point_data["color"] = tubes.color
    lines.point_data["radius"] = np.repeat(tubes.radius, counts)
    return lines.tube(scalars="radius", absolute=True, n_sides=tubes.sides, capping=True)


def slice_mesh(layer: Slice) -> pyvista.ImageData:
    """One flat cell per value; empty ones are not a number, which has a color of its own."""
    others = [i for i in range(3) if i != layer.axis]
    dimensions, origin, spacing = np.ones(3, int), np.zeros(3), np.ones(3)
    dimensions[others] = np.array(layer.values.shape) + 1
    origin[others], origin[layer.axis] = layer.low_mm, layer.position_mm
    spacing[others] = layer.cell_mm
    image = pyvista.ImageData(dimensions=dimensions, origin=origin, spacing=spacing)
    image.cell_data["density"] = np.where(layer.values > 0, layer.values, np.nan).ravel(order="F")
    return image


def axis_sticks(axes: Axes) -> pyvista.PolyData:
    """Thin sticks through the centers; lines would get thinner with smoothing."""
    half = 0.5 * axes.length_mm * axes.directions
    ends = np.stack([axes.centers - half, axes.centers + half], axis=1).reshape(-1, 3)
    cells = np.insert(np.arange(len(ends)), np.arange(0, len(ends), 2), 2)
    lines = pyvista.PolyData(ends, lines=cells)
    lines.point_data["color"] = np.repeat(axes.color, 2, axis=0)
    return lines.tube(radius=STICK * axes.length_mm, n_sides=6)


def level_surface(surface: Surface) -> pyvista.PolyData:
    """Marching cubes between the centers of the cells, closed by a layer of zeros around them."""
    values = np.pad(surface.values, 1)
    low = surface.low_mm - 0.5 * surface.cell_mm
    image = pyvista.ImageData(dimensions=values.shape, origin=low, spacing=[surface.cell_mm] * 3)
    image.point_data["density"] = values.ravel(order="F")
    return image.contour([surface.level], scalars="density", method="flying_edges")


def triangle_mesh(mesh: Triangles) -> pyvista.PolyData:
    return pyvista.PolyData.from_regular_faces(mesh.points, mesh.faces)


def picture_mesh(picture: Picture) -> pyvista.ImageData:
    """One cell per pixel; pictures count their rows from the top."""
    height, width, _ = picture.levels.shape
    image = pyvista.ImageData(dimensions=(width + 1, height + 1, 1))
    image.cell_data["color"] = picture.levels[::-1].reshape(-1, 3)
    return image
