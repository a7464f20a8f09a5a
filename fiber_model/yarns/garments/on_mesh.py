"""Flat cloth laid on a triangle mesh: every control point goes to its place in (u, v), and along the normal.

The pattern is made for each chart's rectangle, cut where the chart ends, and mapped. Pieces that meet across
a seam, end to end and in line, become one yarn again; a course around a tube becomes a loop.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from weft.fiber_model.yarns.catmull_rom import norm
from weft.fiber_model.yarns.yarns import (
    YarnSet,
    concatenate,
    refuse_too_many_points,
    rows_within_types,
)
from weft.files.errors import InputError

from .chart_clip import Pieces, clip_to_chart
from .chart_lookup import ChartLookup
from .charts import Chart
from .garment_report import report_garment
from .hems import Stitches, hem_yarns, seam_yarns
from .seams import join_pieces
from .surface_mesh import SurfaceMesh

ROUNDING = 0.5
"""Part of the way to the tangent planes of a triangle's corners (Phong tessellation): one half reproduces a
sphere to second order; the paper's 3/4 bulges by half as much again."""
MARGIN = 2
"""Periods of the pattern made beyond each side of a chart."""


@dataclass(frozen=True)
class FlatPattern:
    """Cloth in the x, y plane with its face toward +z, which can be made in any size."""

    period_mm: np.ndarray
    """Width and height after which the pattern repeats; 0 for a pattern of one piece that does not."""
    make: Callable[[tuple[float, float]], YarnSet]
    """Yarns of a rectangle of whole periods around the origin."""
    least_piece_mm: float = 0.0
    """Pieces whose cut ends lie nearer to each other than this are loose arcs of slit loops and fall off."""
    make_parts: Callable[[tuple[float, float], np.ndarray | None], Iterator[YarnSet]] | None = None
    """The same yarns in the same order, a few at a time, with rows; only those between the sides of a
    rectangle [mm], shape [2, 2], where one is given. None: they can only be made at once."""

    def parts(self, bounds: np.ndarray, wanted: np.ndarray | None = None) -> Iterator[YarnSet]:
        """Yarns that cover the rectangle `bounds` [mm], shape [2, 2]; periods count from its lower left.

        A few at a time where the pattern can; yarns beside the rectangle `wanted` may be left out.
        """
        if not self.period_mm.all():
            yarns, middle = self.make((0.0, 0.0)), 0.5 * (bounds[0] + bounds[1])
            low, high = yarns.points[:, :2].min(axis=0), yarns.points[:, :2].max(axis=0)
            yield _moved(_numbered(yarns), middle - 0.5 * (low + high))
            return
        periods = np.ceil((bounds[1] - bounds[0]) / self.period_mm - 1e-6) + 2 * MARGIN
        size = (float(periods[0] * self.period_mm[0]), float(periods[1] * self.period_mm[1]))
        middle = bounds[0] - MARGIN * self.period_mm + 0.5 * np.array(size)
        if self.make_parts is None:
            yield _moved(_numbered(self.make(size)), middle)
            return
        for part in self.make_parts(size, None if wanted is None else wanted - middle):
            yield _moved(part, middle)


def lay_on_mesh(
    mesh: SurfaceMesh,
    charts: Sequence[Chart],
    pattern: FlatPattern,
    *,
    offset_mm: float = 0.0,
    join_seams: bool = True,
    hem_mm: float = 0.0,
    region_mm: np.ndarray | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> YarnSet:
    """Cover every chart with `pattern`, `offset_mm` outside of the surface; the result carries a report.

    With `hem_mm` stitches of that depth run around each free border, and over each seam where yarns end,
    in the first yarn of the pattern. With a box `region_mm`, shape [2, 3], only
    triangles within two periods of it are covered.
    """
    fitted = [chart.fitted(pattern.period_mm) if pattern.period_mm.all() else chart for chart in charts]
    seen = fitted
    if region_mm is not None:
        reach = abs(offset_mm) + MARGIN * float(pattern.period_mm.max())
        seen = [chart.within(mesh, region_mm + np.array([[-reach], [reach]])) for chart in fitted]
    parts = []
    for number, (chart, part) in enumerate(zip(fitted, seen, strict=True)):
        if len(part.faces):
            parts += _cover(mesh, chart.bounds, part, pattern, offset_mm)
            refuse_too_many_points(sum(len(part.points) for part in parts), "the garment")
        if progress is not None:
            progress(0.9 * (number + 1) / len(charts), f"chart {number + 1} of {len(charts)}")
    if not parts:
        raise InputError(_nothing_fits(region_mm))
    yarns, summary = _whole_yarns(parts, join_seams)
    if hem_mm > 0:
        yarns = _hemmed(mesh, yarns, summary, hem_mm, offset_mm, region_mm)
    return replace(yarns, report=report_garment(mesh, fitted, yarns, summary))


def _cover(
    mesh: SurfaceMesh, bounds: np.ndarray, chart: Chart, pattern: FlatPattern, offset_mm: float
) -> list[Laid]:
    """The pieces of one chart, from yarns made and cut a few at a time; `bounds` are of all its cloth."""
    lookup, normals, parts = ChartLookup(chart.flat), mesh.vertex_normals(), []
    for flat in pattern.parts(bounds, chart.bounds):
        pieces = clip_to_chart(flat, lookup, least_piece_mm=pattern.least_piece_mm)
        if len(pieces.yarn):
            parts.append(_laid(mesh, normals, chart, pieces, flat, offset_mm))
            refuse_too_many_points(sum(len(part.points) for part in parts), "the garment")
    return parts


def _nothing_fits(region_mm: np.ndarray | None) -> str:
    if region_mm is not None:
        return "yarns.region_mm: no cloth lies in it"
    return "no yarn of the pattern fits on the mesh; its charts are smaller than the pattern"


def _whole_yarns(parts: list[Laid], join_seams: bool) -> tuple[YarnSet, LaidSummary]:
    """The yarns that the pieces make, end to end. Empties `parts`, which take as much memory as they."""
    names = tuple(dict.fromkeys(name for part in parts for name in part.type_names))
    laid = Laid.joined(parts)
    parts.clear()
    joined = join_pieces(laid, reach=1.0 if join_seams else 0.0)
    yarns = YarnSet.checked(
        joined.curves,
        closed=joined.closed,
        radius=laid.radius[joined.first_piece],
        yarn_type=laid.yarn_type[joined.first_piece],
        type_names=names,
        surface_uv=joined.uv,
    )
    summary = LaidSummary(
        laid.chord_length_mm,
        laid.half_thickness_mm,
        joined.joint_count,
        joined.open_end_count,
        stitching_radius_mm=float(laid.radius[0]),
        stitching_type=laid.type_names[laid.yarn_type[0]],
    )
    return replace(yarns, row=laid.row[joined.first_piece]), summary


@dataclass(frozen=True)
class LaidSummary:
    """What stays known of the pieces when they have become yarns."""

    chord_length_mm: tuple[float, float]
    half_thickness_mm: float
    joint_count: int
    open_end_count: int
    stitching_radius_mm: float
    """Radius of the pattern's first yarn, with which hems are sewn."""
    stitching_type: str


@dataclass(frozen=True)
class Laid:
    """Pieces of yarn on the surface, before they are joined."""

    points: np.ndarray
    """Control points [mm], float64, shape [n, 3]."""
    uv: np.ndarray
    """The mesh's own (u, v) at each, float64, shape [n, 2]."""
    offsets: np.ndarray
    """First point of each piece, int64, shape [piece_count + 1]."""
    is_cut: np.ndarray
    """Whether the piece's beginning and end are cuts at a chart's border, bool, shape [piece_count, 2]."""
    closed: np.ndarray
    """Whether the piece is a loop, bool, shape [piece_count]."""
    radius: np.ndarray
    """Yarn radius [mm], float64, shape [piece_count]."""
    yarn_type: np.ndarray
    """Index into `type_names`, int32, shape [piece_count]."""
    row: np.ndarray
    """Number of the yarn in the flat pattern, among those of its type, int64, shape [piece_count]."""
    type_names: tuple[str, ...]
    chord_length_mm: tuple[float, float]
    """Length of all pieces along their chords: on the flat cloth, and on the surface."""
    half_thickness_mm: float
    """Largest distance of a centerline from the middle of the cloth."""

    @classmethod
    def joined(cls, parts: Sequence[Laid]) -> Laid:
        """All parts one after the other; they are of the same pattern, so of the same types."""
        starts = np.cumsum([0] + [len(part.points) for part in parts])
        offsets = [part.offsets[:-1] + start for part, start in zip(parts, starts[:-1], strict=True)]
        arrays = {
            name: np.concatenate([getattr(part, name) for part in parts])
            for name in ("points", "uv", "is_cut", "closed", "radius", "yarn_type", "row")
        }
        return cls(
            **arrays,
            offsets=np.concatenate([*offsets, starts[-1:]]),
            type_names=parts[0].type_names,
            chord_length_mm=(
                sum(part.chord_length_mm[0] for part in parts),
                sum(part.chord_length_mm[1] for part in parts),
            ),
            half_thickness_mm=max(part.half_thickness_mm for part in parts),
        )


def surface_points(
    mesh: SurfaceMesh, normals: np.ndarray, faces: np.ndarray, weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Places [mm] and unit normals on the rounded surface, from triangles and barycentric coordinates.

    Phong tessellation (Boubekeur and Alexa 2008): the flat point is drawn toward its projections onto the
    tangent planes of the three corners, so that yarns do not kink at the edges of triangles.
    """
    corner, weight = mesh.faces[faces], weights[..., None]
    flat = (mesh.vertices[corner] * weight).sum(axis=1)
    normal = normals[corner]
    height = ((flat[:, None] - mesh.vertices[corner]) * normal).sum(axis=2, keepdims=True)
    rounded = flat - ROUNDING * (weight * height * normal).sum(axis=1)
    smooth = (weight * normal).sum(axis=1)
    length = norm(smooth)
    face_normal = np.cross(
        mesh.vertices[corner[:, 1]] - mesh.vertices[corner[:, 0]],
        mesh.vertices[corner[:, 2]] - mesh.vertices[corner[:, 0]],
    )
    smooth = np.where((length > 1e-6)[:, None], smooth, face_normal)
    return rounded, smooth / norm(smooth)[:, None]


def _laid(
    mesh: SurfaceMesh, normals: np.ndarray, chart: Chart, pieces: Pieces, flat: YarnSet, offset_mm: float
) -> Laid:
    """The pieces of one chart on the surface."""
    points, uv = np.empty_like(pieces.points), np.empty((len(pieces.points), 2))
    for begin in range(0, len(points), 1 << 18):
        part = slice(begin, begin + (1 << 18))
        triangle, weights = pieces.triangle[part], pieces.weights[part]
        place, normal = surface_points(mesh, normals, chart.faces[triangle], weights)
        points[part] = place + (pieces.points[part, 2:] + offset_mm) * normal
        uv[part] = (chart.uv[triangle] * weights[..., None]).sum(axis=1)
    assert flat.row is not None
    return Laid(
        points=points,
        uv=uv,
        offsets=pieces.offsets,
        is_cut=pieces.is_cut,
        closed=flat.closed[pieces.yarn],
        radius=flat.radius[pieces.yarn],
        yarn_type=flat.yarn_type[pieces.yarn],
        row=flat.row[pieces.yarn],
        type_names=flat.type_names,
        chord_length_mm=(
            _chord_length(pieces.points, pieces.offsets),
            _chord_length(points, pieces.offsets),
        ),
        half_thickness_mm=float(np.abs(pieces.points[:, 2]).max()),
    )


def _chord_length(points: np.ndarray, offsets: np.ndarray) -> float:
    """Sum of the distances between neighboring points within each piece."""
    chords = norm(np.diff(points, axis=0))
    chords[offsets[1:-1] - 1] = 0.0
    return float(chords.sum())


def _hemmed(
    mesh: SurfaceMesh,
    yarns: YarnSet,
    summary: LaidSummary,
    depth_mm: float,
    offset_mm: float,
    region_mm: np.ndarray | None,
) -> YarnSet:
    """With the stitches that reach the region."""
    stitches = Stitches(depth_mm, summary.half_thickness_mm, summary.stitching_radius_mm, offset_mm)
    first, last = yarns.offsets[:-1][~yarns.closed], yarns.offsets[1:][~yarns.closed] - 1
    open_ends = yarns.points[np.concatenate([first, last])]
    made = [
        hem_yarns(mesh, stitches, type_name=summary.stitching_type),
        seam_yarns(mesh, open_ends, stitches, type_name=summary.stitching_type),
    ]
    return concatenate([yarns, *(part for part in made if part is not None and _reaches(part, region_mm))])


def _reaches(yarns: YarnSet, region_mm: np.ndarray | None) -> bool:
    """Whether any control point lies in the region."""
    if region_mm is None:
        return True
    return bool(((yarns.points >= region_mm[0]) & (yarns.points <= region_mm[1])).all(axis=1).any())


def _numbered(yarns: YarnSet) -> YarnSet:
    """The same yarns with their numbers among those of their type."""
    return replace(yarns, row=rows_within_types(yarns.yarn_type))


def _moved(yarns: YarnSet, by: np.ndarray) -> YarnSet:
    """The same yarns elsewhere in the plane; without twist, which the surface's bending would falsify."""
    return replace(yarns, points=yarns.points + np.append(by, 0.0), twist=None, surface_uv=None)
