"""Small meshes for the tests of garments."""

import numpy as np

from weft.fiber_model.yarns.garments.surface_mesh import SurfaceMesh

HALVES = ((0, 1, 2), (0, 2, 3))


def mapped(surface, u, v, *, uv=lambda u, v: np.stack([u, v], axis=-1), unit=1.0):
    """The surface over the grid `u`, `v`; `surface` and `uv` take arrays of coordinates."""
    i, j = (a.reshape(-1) for a in np.meshgrid(np.arange(len(v) - 1), np.arange(len(u) - 1), indexing="ij"))
    corners = [(i, j), (i, j + 1), (i + 1, j + 1), (i + 1, j)]
    corner_u = np.concatenate([np.stack([u[corners[k][1]] for k in half], 1) for half in HALVES])
    corner_v = np.concatenate([np.stack([v[corners[k][0]] for k in half], 1) for half in HALVES])
    points = surface(corner_u, corner_v).reshape(-1, 3)
    faces = np.arange(len(points)).reshape(-1, 3)
    return SurfaceMesh.checked(points, faces, uv(corner_u, corner_v), uv_unit_mm=unit)


def plane(width=40.0, height=30.0, **options):
    """A rectangle in the x, y plane that faces +z."""
    return mapped(
        lambda u, v: np.stack([u, v, 0 * u], axis=-1),
        np.linspace(0, width, 9),
        np.linspace(0, height, 7),
        **options,
    )


def cylinder(radius=20.0, height=40.0, around=48, **options):
    """A tube around the y axis that faces outward; its seam is a line of UVs only."""

    def surface(u, v):
        angle = u / radius
        return np.stack([radius * np.sin(angle), v, radius * np.cos(angle)], axis=-1)

    return mapped(
        surface, np.linspace(0, 2 * np.pi * radius, around + 1), np.linspace(0, height, 9), **options
    )
