"""Flat yarns cut where a chart ends: pieces that begin and end exactly on its border."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from weft.fiber_model.yarns.catmull_rom import CatmullRom, segment_coefficients
from weft.fiber_model.yarns.fabrics.cut import MERGE, MIN_PIECE_RADII
from weft.fiber_model.yarns.yarns import MIN_POINTS, YarnSet

from .chart_lookup import ChartLookup

BISECTIONS = 44


@dataclass(frozen=True)
class Pieces:
    """What lies on the chart, piece after piece."""

    points: np.ndarray
    """Control points [mm] on and above the flat cloth, float64, shape [n, 3]."""
    triangle: np.ndarray
    """Triangle of the chart that holds each, int64, shape [n]."""
    weights: np.ndarray
    """Barycentric coordinates there, float64, shape [n, 3]."""
    offsets: np.ndarray
    """First point of each piece, int64, shape [piece_count + 1]."""
    yarn: np.ndarray
    """Flat yarn that each piece was cut from, int64, shape [piece_count]."""
    is_cut: np.ndarray
    """Whether its beginning and its end lie on the border, bool, shape [piece_count, 2]."""


@dataclass(frozen=True)
class _Runs:
    """Stretches of control points on the chart."""

    first: np.ndarray
    last: np.ndarray
    yarn: np.ndarray
    is_cut: np.ndarray

    def __getitem__(self, kept: np.ndarray) -> _Runs:
        return _Runs(self.first[kept], self.last[kept], self.yarn[kept], self.is_cut[kept])


def clip_to_chart(yarns: YarnSet, lookup: ChartLookup, *, least_piece_mm: float) -> Pieces:
    """Cut `yarns` at the chart's border.

    Pieces whose ends are less than `least_piece_mm` or a few radii apart fall off: they are loose arcs of
    loops that the border slits. So do closed yarns that are not wholly inside.
    """
    triangle, weights = lookup.locate(yarns.points[:, :2])
    runs = _runs(yarns, triangle >= 0)
    runs = runs[_large_enough(yarns, runs, least_piece_mm)]
    begin = _crossings(yarns, lookup, runs, 0)
    end = _crossings(yarns, lookup, runs, 1)
    return _assembled(yarns, lookup, runs, (begin, end), triangle, weights)


def _runs(yarns: YarnSet, inside: np.ndarray) -> _Runs:
    """Stretches of inner points; a loop is one stretch or none."""
    yarn = np.repeat(np.arange(yarns.yarn_count), yarns.point_counts)
    whole = np.minimum.reduceat(inside, yarns.offsets[:-1])
    inside = inside & (whole | ~yarns.closed)[yarn]
    at_first, at_last = np.zeros(len(inside), bool), np.zeros(len(inside), bool)
    at_first[yarns.offsets[:-1]] = at_last[yarns.offsets[1:] - 1] = True
    first = np.flatnonzero(inside & (at_first | ~np.roll(inside, 1)))
    last = np.flatnonzero(inside & (at_last | ~np.roll(inside, -1)))
    return _Runs(first, last, yarn[first], np.stack([~at_first[first], ~at_last[last]], axis=1))


def _large_enough(yarns: YarnSet, runs: _Runs, least_piece_mm: float) -> np.ndarray:
    """Which stretches stay, bool, shape [run_count]; those that nothing cut always do."""
    ends = yarns.points[runs.last, :2] - yarns.points[runs.first, :2]
    least = np.maximum(least_piece_mm, MIN_PIECE_RADII * yarns.radius[runs.yarn])
    large = (np.hypot(*ends.T) >= least) & (runs.last - runs.first + 1 >= MIN_POINTS)
    return large | ~runs.is_cut.any(axis=1)


def _crossings(yarns: YarnSet, lookup: ChartLookup, runs: _Runs, side: int) -> tuple[np.ndarray, np.ndarray]:
    """Where runs leave the chart: the point [mm], and its distance in chords from the run's last inner point.

    Rows of runs that are not cut on this side mean nothing.
    """
    run = np.flatnonzero(runs.is_cut[:, side])
    point = (runs.first, runs.last)[side][run] - (1 - side)
    yarn = runs.yarn[run]
    segment = np.arange(len(run))
    coefficients = segment_coefficients(yarns, yarn, point - yarns.offsets[yarn])
    curves = CatmullRom(coefficients, np.array([0, len(run)]))
    inner, outer = np.full(len(run), 1.0 - side), np.full(len(run), float(side))
    for _ in range(BISECTIONS):
        middle = 0.5 * (inner + outer)
        found = lookup.locate(curves.position(segment, middle)[:, :2])[0] >= 0
        inner, outer = np.where(found, middle, inner), np.where(found, outer, middle)
    points, chords = np.zeros((len(runs.first), 3)), np.full(len(runs.first), np.inf)
    points[run] = curves.position(segment, inner)
    chords[run] = np.abs(inner - (1.0 - side))
    return points, chords


def _assembled(
    yarns: YarnSet,
    lookup: ChartLookup,
    runs: _Runs,
    ends: tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]],
    triangle: np.ndarray,
    weights: np.ndarray,
) -> Pieces:
    """The inner points of each run between its crossings, which replace inner points that are very near."""
    first = runs.first + (ends[0][1] < MERGE)
    last = runs.last - (ends[1][1] < MERGE)
    inner_count = last - first + 1
    offsets = np.concatenate([[0], np.cumsum(inner_count + runs.is_cut.sum(axis=1))])
    points = np.empty((offsets[-1], 3))
    new_triangle, new_weights = np.empty(offsets[-1], np.int64), np.empty((offsets[-1], 3))
    nth = np.arange(inner_count.sum()) - np.repeat(np.cumsum(inner_count) - inner_count, inner_count)
    source = np.repeat(first, inner_count) + nth
    target = np.repeat(offsets[:-1] + runs.is_cut[:, 0], inner_count) + nth
    points[target], new_triangle[target], new_weights[target] = (
        yarns.points[source],
        triangle[source],
        weights[source],
    )
    for side, place in enumerate((offsets[:-1], offsets[1:] - 1)):
        cut = runs.is_cut[:, side]
        points[place[cut]] = ends[side][0][cut]
        new_triangle[place[cut]], new_weights[place[cut]] = lookup.locate(points[place[cut], :2])
    return Pieces(points, new_triangle, new_weights, offsets, runs.yarn, runs.is_cut)
