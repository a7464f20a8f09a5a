"""Hems and seams: yarns in overcast stitches around free borders, and over seams where yarns end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from weft.fiber_model.yarns.yarns import YarnSet

from .borders import Border, chart_seams, free_borders
from .surface_mesh import SurfaceMesh, unit_rows

POINTS_PER_STITCH = 16
PITCH_PER_RADIUS = 4.0
"""Distance of stitches along the border; neighbors leave a yarn's width between them."""
FEWEST_STITCHES = 4


@dataclass(frozen=True)
class Stitches:
    """How far stitches reach; the centerlines of the cloth lie within a half thickness of its middle."""

    depth_mm: float
    """Into the cloth from its border, or to both sides of a seam."""
    half_thickness_mm: float
    radius_mm: float
    offset_mm: float = 0.0
    """Distance of the middle of the cloth from the surface."""

    @property
    def height_mm(self) -> float:
        """Distance of the stitching yarn from the middle of the cloth: outside of all its yarns."""
        return self.half_thickness_mm + 2 * self.radius_mm


def hem_yarns(mesh: SurfaceMesh, stitches: Stitches, *, type_name: str = "yarn") -> YarnSet | None:
    """One closed yarn for each free border; None where the mesh has none."""
    return _stitched(mesh, free_borders(mesh), stitches, 2 * stitches.radius_mm, type_name)


def seam_yarns(
    mesh: SurfaceMesh, open_ends: np.ndarray, stitches: Stitches, *, type_name: str = "yarn"
) -> YarnSet | None:
    """One yarn over each seam between charts at which some of `open_ends` [mm], shape [n, 3], lie."""
    from scipy.spatial import cKDTree

    seams = chart_seams(mesh)
    if not len(open_ends) or not seams:
        return None
    ends = cKDTree(open_ends)
    reach = stitches.depth_mm + stitches.height_mm + abs(stitches.offset_mm)
    held = [seam for seam in seams if np.isfinite(_distances(mesh, seam, ends, reach)).any()]
    return _stitched(mesh, held, stitches, stitches.depth_mm, type_name)


def _distances(mesh: SurfaceMesh, seam: Border, ends: object, reach: float) -> np.ndarray:
    """From places along the seam, `reach` apart at most, to the nearest end; infinite beyond `reach`."""
    place, arc = _path(mesh, seam)
    s = np.linspace(0, arc[-1], int(np.ceil(arc[-1] / reach)) + 1)
    return ends.query(_at(s, arc, place), distance_upper_bound=reach)[0]  # type: ignore[attr-defined]


def _stitched(
    mesh: SurfaceMesh, borders: Sequence[Border], stitches: Stitches, outward_mm: float, type_name: str
) -> YarnSet | None:
    normals = mesh.vertex_normals()
    made = [(_overcast(mesh, normals, border, stitches, outward_mm), border.closed) for border in borders]
    curves = [(*curve, closed) for curve, closed in made if curve is not None]
    if not curves:
        return None
    points, uv, closed = zip(*curves, strict=True)
    return YarnSet.checked(
        list(points),
        closed=list(closed),
        radius=stitches.radius_mm,
        type_names=(type_name,),
        surface_uv=list(uv),
    )


def _overcast(
    mesh: SurfaceMesh, normals: np.ndarray, border: Border, stitches: Stitches, outward: float
) -> tuple[np.ndarray, np.ndarray] | None:
    """Control points [mm] and (u, v) of a row of stitches; None where the border is too short for any."""
    face, corner = border.half_edges // 3, border.half_edges % 3
    place, arc = _path(mesh, border)
    count = round(float(arc[-1]) / (PITCH_PER_RADIUS * stitches.radius_mm))
    if count < FEWEST_STITCHES:
        return None
    normal = normals[_vertices(mesh, border)]
    inward = unit_rows(np.cross(normal, _along(place, border.closed)))
    turn = 2 * np.pi * np.arange(count * POINTS_PER_STITCH) / POINTS_PER_STITCH
    s = arc[-1] * turn / (2 * np.pi * count)
    center, normal, inward = (_at(s, arc, values) for values in (place, normal, inward))
    reach = 0.5 * stitches.depth_mm * (1 + np.cos(turn)) - 0.5 * outward * (1 - np.cos(turn))
    height = stitches.offset_mm + stitches.height_mm * np.sin(turn)
    points = center + reach[:, None] * unit_rows(inward) + height[:, None] * unit_rows(normal)
    if mesh.uv is None:
        return points, np.zeros((len(points), 2))
    edge = np.clip(np.searchsorted(arc, s, side="right") - 1, 0, len(face) - 1)
    part = ((s - arc[edge]) / np.diff(arc)[edge])[:, None]
    here, there = mesh.uv[face, corner], mesh.uv[face, (corner + 1) % 3]
    return points, (1 - part) * here[edge] + part * there[edge]


def _vertices(mesh: SurfaceMesh, border: Border) -> np.ndarray:
    """From the first edge's start to the last one's end, which repeats the first on a loop."""
    face, corner = border.half_edges // 3, border.half_edges % 3
    return np.append(mesh.faces[face, corner], mesh.faces[face[-1], (corner[-1] + 1) % 3])


def _path(mesh: SurfaceMesh, border: Border) -> tuple[np.ndarray, np.ndarray]:
    """Places [mm] along the border, shape [n + 1, 3], and the arc length at each."""
    place = mesh.vertices[_vertices(mesh, border)]
    return place, np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(place, axis=0), axis=1))])


def _along(place: np.ndarray, closed: bool) -> np.ndarray:
    """Unit direction of the border at each place, the mean of its two edges."""
    chord = np.diff(place, axis=0)
    before = np.concatenate([chord[-1:] if closed else chord[:1], chord])
    after = np.concatenate([chord, chord[:1] if closed else chord[-1:]])
    return unit_rows(before + after)


def _at(s: np.ndarray, arc: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Vectors at arc lengths `s`, linear between the border's vertices, shape [n, 3]."""
    return np.stack([np.interp(s, arc, values[:, axis]) for axis in range(3)], axis=1)
