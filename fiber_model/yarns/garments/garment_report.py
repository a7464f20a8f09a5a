"""What a person should know about cloth laid on a mesh: stretch and where, yarn length, seams."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from weft.fiber_model.yarns.catmull_rom import yarn_lengths
from weft.fiber_model.yarns.yarns import YarnSet

from .charts import Chart, jacobians
from .surface_mesh import SurfaceMesh, double_areas

if TYPE_CHECKING:
    from .on_mesh import LaidSummary

STRETCH_NOTED = (0.7, 1.4)
"""Stretch beyond which cloth shows gaps or crowds, and a warning says so."""


@dataclass(frozen=True)
class GarmentReport:
    """Stretch is length on the surface over length on the flat cloth; 1 is as designed."""

    yarn_length_mm: float
    yarn_stretch: float
    """Length of the cloth's yarns over what they measure when it is flat."""
    surface_area_mm2: float
    covered_area_mm2: float
    """Area of the triangles that lie on a chart, face up and with extent."""
    stretch_min: float
    """Least stretch of any triangle in any direction."""
    stretch_min_at_mm: tuple[float, float, float]
    """Middle of that triangle."""
    stretch_mean: float
    """Root of the covered area over its area as flat cloth."""
    stretch_max: float
    """Largest stretch of any triangle in any direction."""
    stretch_max_at_mm: tuple[float, float, float]
    """Middle of that triangle."""
    stretch_middle: tuple[float, float]
    """Least and largest stretch of all but the worst 1 % of the area on either side."""
    chart_count: int
    loop_count: int
    """Yarns that close: courses around a tube, and hems."""
    joint_count: int
    """Places where a yarn goes on across a seam."""
    open_end_count: int
    """Yarn ends cut at a border or seam where nothing continues them."""
    warnings: tuple[str, ...] = ()


def report_garment(
    mesh: SurfaceMesh, charts: Sequence[Chart], yarns: YarnSet, laid: LaidSummary
) -> GarmentReport:
    """Sum up; `charts` as they were laid, after they were fitted to the pattern."""
    faces = np.concatenate([chart.faces for chart in charts])
    stretch = np.concatenate([principal_stretches(mesh, chart) for chart in charts])
    area = 0.5 * double_areas(mesh.vertices, mesh.faces[faces])
    flat_area = float((area / stretch.prod(axis=1)).sum())
    middle = mesh.vertices[mesh.faces[faces]].mean(axis=1)
    least, most = int(np.argmin(stretch[:, 0])), int(np.argmax(stretch[:, 1]))
    most_of_it = (_quantile(stretch[:, 0], area, 0.01), _quantile(stretch[:, 1], area, 0.99))
    return GarmentReport(
        yarn_length_mm=float(yarn_lengths(yarns).sum()),
        yarn_stretch=laid.chord_length_mm[1] / laid.chord_length_mm[0],
        surface_area_mm2=mesh.area,
        covered_area_mm2=float(area.sum()),
        stretch_min=float(stretch[least, 0]),
        stretch_min_at_mm=_place(middle[least]),
        stretch_mean=float(np.sqrt(area.sum() / flat_area)),
        stretch_max=float(stretch[most, 1]),
        stretch_max_at_mm=_place(middle[most]),
        stretch_middle=most_of_it,
        chart_count=len(charts),
        loop_count=int(yarns.closed.sum()),
        joint_count=laid.joint_count,
        open_end_count=laid.open_end_count,
        warnings=tuple(_warnings(most_of_it, mesh.area, float(area.sum()))),
    )


def principal_stretches(mesh: SurfaceMesh, chart: Chart) -> np.ndarray:
    """Least and largest stretch of each triangle of a chart, shape [n, 2]."""
    jacobian = jacobians(mesh, chart)
    metric = jacobian.transpose(0, 2, 1) @ jacobian
    return np.sqrt(np.clip(np.linalg.eigvalsh(metric), 1e-300, None))


def _quantile(values: np.ndarray, weights: np.ndarray, part: float) -> float:
    """The value below which `part` of the weight lies."""
    order = np.argsort(values)
    cumulative = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(cumulative, part * cumulative[-1])])


def _place(point: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (round(float(value), 3) for value in point)
    return x, y, z


def _warnings(most_of_it: tuple[float, float], area: float, covered: float) -> list[str]:
    found = []
    low, high = STRETCH_NOTED
    if most_of_it[0] < low or most_of_it[1] > high:
        found.append(
            f"the cloth is stretched {most_of_it[0]:.2g} to {most_of_it[1]:.2g} times (without the worst 1 % "
            f"of the area); from {low} to {high} it looks right. Check the mesh's UVs and their unit."
        )
    if covered < 0.999 * area:
        found.append(
            f"{1 - covered / area:.1%} of the surface is bare: its UVs are folded over or have no area."
        )
    return found
