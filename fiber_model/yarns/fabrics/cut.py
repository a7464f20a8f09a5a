"""Cutting yarns at the border of a rectangle, as scissors would: each piece ends exactly on the border."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from weft.fiber_model.yarns.catmull_rom import CatmullRom, norm
from weft.fiber_model.yarns.yarns import MIN_POINTS, YarnSet

MIN_PIECE_RADII = 4.0
"""Pieces shorter than this many yarn radii fall off."""
MERGE = 0.5
"""An end within this part of a chord from the last control point replaces it: uniform Catmull-Rom curves
overshoot where a very short chord follows a long one."""


@dataclass(frozen=True)
class Piece:
    """What is left of a yarn in one stretch: its control points as parameters along the old yarn.

    Parameter 2.5 lies in the middle between control points 2 and 3.
    """

    yarn: int
    parameters: np.ndarray


def cut_to_rectangle(
    yarns: YarnSet, size_mm: tuple[float, float], *, cut_axes: np.ndarray | None = None
) -> YarnSet | None:
    """The parts of `yarns` within the rectangle `size_mm` around the origin; None where nothing is left.

    `cut_axes`, bool, shape [yarn_count, 2], says along which of x and y a yarn is cut; along the others it is
    kept or dropped whole by the middle of its extent. Loops are never cut.
    """
    axes = np.ones((yarns.yarn_count, 2), bool) if cut_axes is None else cut_axes & ~yarns.closed[:, None]
    half = 0.5 * np.asarray(size_mm, dtype=np.float64)
    limit = np.where(axes, half, np.inf)
    curves = CatmullRom.through(yarns)
    pieces = []
    for yarn in np.flatnonzero(_middle_is_inside(yarns, half, axes)):
        inside = (np.abs(yarns.yarn(int(yarn))[:, :2]) <= limit[yarn]).all(axis=1)
        pieces += [
            Piece(int(yarn), _piece_parameters(curves, int(yarn), inside, first, last, limit[yarn]))
            for first, last in _runs(inside)
        ]
    return _take_pieces(yarns, curves, pieces)


def _middle_is_inside(yarns: YarnSet, half: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Whether each yarn passes the test on the axes along which it is not cut, bool, shape [yarn_count]."""
    low = np.minimum.reduceat(yarns.points[:, :2], yarns.offsets[:-1])
    high = np.maximum.reduceat(yarns.points[:, :2], yarns.offsets[:-1])
    middle = 0.5 * (low + high)
    # half-open and nudged, so that a whole number of rows stays whole whatever the rounding
    nudge = 1e-9 * half
    return np.all(axes | ((middle >= -half - nudge) & (middle < half - nudge)), axis=1)


def _runs(inside: np.ndarray) -> list[tuple[int, int]]:
    """First and last index of every stretch of true entries."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]])))
    return [(int(first), int(last) - 1) for first, last in zip(edges[::2], edges[1::2], strict=True)]


def _piece_parameters(
    curves: CatmullRom, yarn: int, inside: np.ndarray, first: int, last: int, limit: np.ndarray
) -> np.ndarray:
    """Parameters of the control points first..last and of where the yarn crosses the border beside them."""
    parameters = np.arange(first, last + 1, dtype=np.float64)
    if first > 0:
        start = _crossing(curves, yarn, float(first), first - 1.0, limit)
        parameters = np.append(start, parameters[parameters - start > MERGE])
    if last < len(inside) - 1:
        end = _crossing(curves, yarn, float(last), last + 1.0, limit)
        parameters = np.append(parameters[end - parameters > MERGE], end)
    if len(parameters) < MIN_POINTS:
        parameters = np.linspace(parameters[0], parameters[-1], MIN_POINTS)
    return parameters


def _crossing(curves: CatmullRom, yarn: int, inside: float, outside: float, limit: np.ndarray) -> float:
    """Parameter at which the curve leaves the rectangle between two control points, by bisection."""
    for _ in range(52):
        middle = 0.5 * (inside + outside)
        if (np.abs(_position(curves, yarn, np.array([middle]))[0, :2]) <= limit).all():
            inside = middle
        else:
            outside = middle
    return inside


def _position(curves: CatmullRom, yarn: int, parameters: np.ndarray) -> np.ndarray:
    """Point [mm] at parameters that count control points, shape [n, 3]."""
    count = curves.offsets[yarn + 1] - curves.offsets[yarn]
    local = np.clip(np.floor(parameters).astype(np.int64), 0, count - 1)
    return curves.position(curves.offsets[yarn] + local, parameters - local)


def _take_pieces(yarns: YarnSet, curves: CatmullRom, pieces: list[Piece]) -> YarnSet | None:
    """A set of the pieces that are long enough, with everything the old yarns carried."""
    curve = [_position(curves, piece.yarn, piece.parameters) for piece in pieces]
    length = np.array([norm(np.diff(points, axis=0)).sum() for points in curve])
    kept = [k for k, piece in enumerate(pieces) if length[k] >= MIN_PIECE_RADII * yarns.radius[piece.yarn]]
    if not kept:
        return None
    yarn = np.array([pieces[k].yarn for k in kept])
    return YarnSet.checked(
        [curve[k] for k in kept],
        closed=yarns.closed[yarn],
        radius=yarns.radius[yarn],
        yarn_type=yarns.yarn_type[yarn],
        type_names=yarns.type_names,
        twist=_values_at(yarns, yarns.twist, [pieces[k] for k in kept]),
        surface_uv=_values_at(yarns, yarns.surface_uv, [pieces[k] for k in kept]),
    )


def _values_at(yarns: YarnSet, values: np.ndarray | None, pieces: list[Piece]) -> list[np.ndarray] | None:
    """Per-point values at the control points of the pieces, linear between the old ones."""
    if values is None:
        return None
    result = []
    for piece in pieces:
        own = values[yarns.offsets[piece.yarn] : yarns.offsets[piece.yarn + 1]]
        low = np.clip(np.floor(piece.parameters).astype(np.int64), 0, len(own) - 2)
        part = (piece.parameters - low).reshape((-1,) + (1,) * (own.ndim - 1))
        result.append((1 - part) * own[low] + part * own[low + 1])
    return result
