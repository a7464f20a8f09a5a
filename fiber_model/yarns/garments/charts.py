"""Charts: the connected pieces of a mesh's surface coordinates, as flat cloth in mm, face up."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from weft.files.errors import InputError

from .surface_mesh import SurfaceMesh, double_areas

SAME_UV = 1e-6
"""Corners closer than this part of the extent of all (u, v) are one place."""
LEVEL = 0.05
"""A chart whose mean upward slope along the cloth is below this has no grain to turn upright."""


@dataclass(frozen=True)
class Chart:
    """Triangles that lie side by side in the plane of the cloth, all counterclockwise there."""

    faces: np.ndarray
    """Triangles of the mesh, int64, shape [n]."""
    flat: np.ndarray
    """Corners on the flat cloth [mm], float64, shape [n, 3, 2]."""
    uv: np.ndarray
    """The same corners in the mesh's own (u, v), float64, shape [n, 3, 2]."""
    seam_step: np.ndarray
    """Where the chart meets itself along a seam, the step [mm] across it, shape [2]; 0 where it does not."""

    @property
    def bounds(self) -> np.ndarray:
        """Lowest and highest corner [mm], shape [2, 2]."""
        corners = self.flat.reshape(-1, 2)
        return np.array([corners.min(axis=0), corners.max(axis=0)])

    def fitted(self, period_mm: np.ndarray) -> Chart:
        """Stretched a little, so that a whole number of pattern periods goes around where it meets itself."""
        step = np.abs(self.seam_step)
        repeats = np.maximum(np.round(step / period_mm), 1)
        factor = np.where(step > 0, repeats * period_mm / np.where(step > 0, step, 1.0), 1.0)
        return replace(self, flat=self.flat * factor, seam_step=self.seam_step * factor)

    def within(self, mesh: SurfaceMesh, box_mm: np.ndarray) -> Chart:
        """Only the triangles whose bounding boxes meet `box_mm`, shape [2, 3]."""
        corners = mesh.vertices[mesh.faces[self.faces]]
        low, high = corners.min(axis=1), corners.max(axis=1)
        kept = ((low <= box_mm[1]) & (high >= box_mm[0])).all(axis=1)
        return replace(self, faces=self.faces[kept], flat=self.flat[kept], uv=self.uv[kept])


def build_charts(
    mesh: SurfaceMesh,
    *,
    scale: Literal["chart", "mesh"] = "chart",
    grain: Literal["uv", "up"] = "uv",
) -> list[Chart]:
    """The charts of `mesh`, largest first. Mirrored ones are turned over, so that no knit comes out mirrored.

    Without a known unit (u, v) is scaled to the area of the surface, for each chart or for the whole mesh.
    Grain "up" turns each chart so that +y on the cloth goes upward on the surface.
    """
    if mesh.uv is None:
        raise InputError("the mesh has no surface coordinates (UVs)")
    label = _connected_faces(mesh)
    area, uv_area = double_areas(mesh.vertices, mesh.faces), _signed_double_areas(mesh.uv)
    if not np.abs(uv_area).any():
        raise InputError("the surface coordinates of the mesh have no area: all its UVs lie on a line")
    whole = np.sqrt(area.sum() / np.abs(uv_area).sum())
    order = np.argsort(label, kind="stable")
    charts = []
    for faces in np.split(order, np.flatnonzero(np.diff(label[order])) + 1):
        if not np.abs(uv_area[faces]).any():
            continue
        own = np.sqrt(area[faces].sum() / np.abs(uv_area[faces]).sum())
        unit = mesh.uv_unit_mm or (own if scale == "chart" else whole)
        charts.append(_chart(mesh, faces, unit, grain))
    return sorted(charts, key=lambda chart: -float(area[chart.faces].sum()))


def jacobians(mesh: SurfaceMesh, chart: Chart) -> np.ndarray:
    """d(surface) / d(flat cloth) of each triangle of a chart, shape [n, 3, 2]."""
    corner = mesh.vertices[mesh.faces[chart.faces]]
    surface = np.stack([corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]], axis=2)
    flat = np.stack([chart.flat[:, 1] - chart.flat[:, 0], chart.flat[:, 2] - chart.flat[:, 0]], axis=2)
    return surface @ np.linalg.inv(flat)


def _chart(mesh: SurfaceMesh, faces: np.ndarray, unit_mm: float, grain: str) -> Chart:
    """One chart, turned face up; triangles folded over within it are left out."""
    assert mesh.uv is not None
    uv = mesh.uv[faces]
    signed = _signed_double_areas(uv)
    facing = 1.0 if signed.sum() >= 0 else -1.0
    kept = facing * signed > 1e-12 * np.abs(signed).max()
    faces, uv = faces[kept], uv[kept]
    flat = uv * unit_mm * np.array([facing, 1.0])
    chart = Chart(faces, flat, uv, np.zeros(2))
    if grain == "up":
        chart = replace(chart, flat=flat @ _upright(mesh, chart).T)
    return replace(chart, seam_step=_seam_step(mesh, chart))


def _upright(mesh: SurfaceMesh, chart: Chart) -> np.ndarray:
    """Rotation of the plane, shape [2, 2], after which the surface rises along +y on average."""
    weight = _signed_double_areas(chart.flat)
    rise = (jacobians(mesh, chart)[:, 1, :] * weight[:, None]).sum(axis=0) / weight.sum()
    size = float(np.hypot(*rise))
    if size < LEVEL:
        return np.eye(2)
    x, y = rise / size
    return np.array([[y, -x], [x, y]])


def _seam_step(mesh: SurfaceMesh, chart: Chart) -> np.ndarray:
    """The translation that takes one side of the chart's own seam to the other, if it is one along x or y."""
    local = np.full(mesh.face_count, -1, np.int64)
    local[chart.faces] = np.arange(len(chart.faces))
    twin = mesh.twins().reshape(-1, 3)[chart.faces]
    face, corner = np.nonzero(twin >= 0)
    other, other_corner = local[twin[face, corner] // 3], twin[face, corner] % 3
    inside = other >= 0
    face, corner, other, other_corner = (a[inside] for a in (face, corner, other, other_corner))
    at_start = chart.flat[face, corner] - chart.flat[other, (other_corner + 1) % 3]
    at_end = chart.flat[face, (corner + 1) % 3] - chart.flat[other, other_corner]
    extent = float(np.ptp(chart.flat.reshape(-1, 2), axis=0).max())
    step = np.zeros(2)
    moved = np.abs(at_start).max(axis=1) > 1e-3 * extent
    rigid = np.abs(at_start - at_end).max(axis=1) < 1e-4 * extent
    for axis in range(2):
        straight = np.abs(at_start[:, 1 - axis]) < 1e-4 * extent
        steps = np.abs(at_start[moved & rigid & straight, axis])
        if len(steps) and np.ptp(steps) < 1e-3 * extent:
            step[axis] = np.median(steps)
    return step


def _connected_faces(mesh: SurfaceMesh) -> np.ndarray:
    """Number of the chart that each face belongs to: neighbors on the surface and in (u, v), shape [n]."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    assert mesh.uv is not None
    near = SAME_UV * float(np.ptp(mesh.uv.reshape(-1, 2), axis=0).max())
    twin = mesh.twins()
    half = np.flatnonzero(twin >= 0)
    other = twin[half]
    start, end = mesh.uv.reshape(-1, 2), np.roll(mesh.uv, -1, axis=1).reshape(-1, 2)
    apart = np.maximum(np.abs(start[half] - end[other]), np.abs(end[half] - start[other])).max(axis=1)
    half, other = half[apart <= near], other[apart <= near]
    links = coo_array((np.ones(len(half), np.int8), (half // 3, other // 3)), shape=(mesh.face_count,) * 2)
    return np.asarray(connected_components(links, directed=False)[1])


def _signed_double_areas(corners: np.ndarray) -> np.ndarray:
    """Twice the area of plane triangles, positive where counterclockwise; `corners` has shape [n, 3, 2]."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
