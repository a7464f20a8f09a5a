"""Yarn centerlines: what every yarn source makes and every later stage reads."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from weft.files.errors import InputError

if TYPE_CHECKING:
    from .garments.garment_report import GarmentReport

MIN_POINTS = 4
"""Fewest control points of a centerline."""
MAX_COORDINATE_MM = 1e7
"""Ten kilometers: larger coordinates are a wrong unit or a corrupt file."""

TYPE_NAME = r"[A-Za-z][A-Za-z0-9_]{0,31}"
"""Yarn types name the grids of the volume, which other programs read, too."""
MAX_POINTS = 100_000_000
"""Control points that a generator or reader may make: 2.4 GB of coordinates."""


@dataclass(frozen=True)
class YarnSet:
    """Yarns as uniform Catmull-Rom curves through their control points.

    A closed yarn's last point joins its first; the first point is not repeated at the end.
    Construction checks every field and raises `InputError`; readers pass `source` through `checked`
    so that the message names their file.
    """

    points: np.ndarray
    """Control points [mm], float64, shape [point_count, 3]; the curve passes through each of them."""
    offsets: np.ndarray
    """First point of each yarn, int64, shape [yarn_count + 1]."""
    closed: np.ndarray
    """Whether the yarn is a loop, bool, shape [yarn_count]."""
    radius: np.ndarray
    """Yarn radius [mm], float64, shape [yarn_count]."""
    yarn_type: np.ndarray
    """Index into `type_names`, int32, shape [yarn_count]."""
    type_names: tuple[str, ...] = ("yarn",)
    """One name per yarn type; each type becomes one medium of the volume."""
    twist: np.ndarray | None = None
    """Material twist against the rotation-minimizing frame [rad], float64, shape [point_count]."""
    surface_uv: np.ndarray | None = None
    """Surface coordinates of each point [1], float64, shape [point_count, 2]."""
    row: np.ndarray | None = None
    """Number of each yarn among those of its type in the pattern it was cut from, int64, shape [yarn_count];
    stripes go by it. None: yarns are counted as they come."""
    report: GarmentReport | None = field(default=None, compare=False)
    """What was found out when the yarns were laid on a mesh; not stored in files."""

    def __post_init__(self) -> None:
        _normalize_dtypes(self)
        _check_shapes(self)
        _check_values(self)

    @classmethod
    def checked(
        cls,
        curves: Sequence[np.ndarray],
        *,
        closed: Sequence[bool] | bool = False,
        radius: Sequence[float] | float,
        yarn_type: Sequence[int] | int = 0,
        type_names: tuple[str, ...] = ("yarn",),
        twist: Sequence[np.ndarray] | None = None,
        surface_uv: Sequence[np.ndarray] | None = None,
        source: str | Path | None = None,
    ) -> YarnSet:
        """Build from one array of control points [mm], shape [n, 3], per yarn; errors name `source`."""
        count = len(curves)
        counts = [len(curve) for curve in curves]
        try:
            return cls(
                points=np.concatenate(curves) if count else np.zeros((0, 3)),
                offsets=np.concatenate([[0], np.cumsum(counts, dtype=np.int64)]),
                closed=np.broadcast_to(np.asarray(closed, dtype=bool), (count,)).copy(),
                radius=np.broadcast_to(np.asarray(radius, dtype=np.float64), (count,)).copy(),
                yarn_type=np.broadcast_to(np.asarray(yarn_type, dtype=np.int32), (count,)).copy(),
                type_names=type_names,
                twist=None if twist is None else np.concatenate(twist),
                surface_uv=None if surface_uv is None else np.concatenate(surface_uv),
            )
        except InputError as error:
            raise InputError(error.what, path=source, place=error.place, hint=error.hint) from None

    @property
    def yarn_count(self) -> int:
        """Number of yarns."""
        return len(self.offsets) - 1

    @property
    def point_count(self) -> int:
        """Number of control points of all yarns together."""
        return len(self.points)

    @property
    def point_counts(self) -> np.ndarray:
        """Control points per yarn, int64, shape [yarn_count]."""
        return np.diff(self.offsets)

    @property
    def bounds(self) -> np.ndarray:
        """Lowest and highest control point coordinates widened by the yarn radius [mm], shape [2, 3]."""
        radius = np.repeat(self.radius, self.point_counts)[:, None]
        return np.array([(self.points - radius).min(axis=0), (self.points + radius).max(axis=0)])

    def yarn(self, index: int) -> np.ndarray:
        """Control points [mm] of one yarn, shape [n, 3] (a view)."""
        return self.points[self.offsets[index] : self.offsets[index + 1]]


def concatenate(yarn_sets: Sequence[YarnSet]) -> YarnSet:
    """Join several sets into one; types with the same name become one type."""
    if not yarn_sets:
        raise ValueError("concatenate needs at least one YarnSet")
    names = tuple(dict.fromkeys(name for yarns in yarn_sets for name in yarns.type_names))
    renumbered = [
        np.array([names.index(name) for name in yarns.type_names], np.int32)[yarns.yarn_type]
        for yarns in yarn_sets
    ]
    starts = np.cumsum([0] + [yarns.point_count for yarns in yarn_sets])
    offsets = [yarns.offsets[:-1] + start for yarns, start in zip(yarn_sets, starts[:-1], strict=True)]
    return YarnSet(
        points=np.concatenate([yarns.points for yarns in yarn_sets]),
        offsets=np.concatenate([*offsets, starts[-1:]]),
        closed=np.concatenate([yarns.closed for yarns in yarn_sets]),
        radius=np.concatenate([yarns.radius for yarns in yarn_sets]),
        yarn_type=np.concatenate(renumbered),
        type_names=names,
        twist=_joined([yarns.twist for yarns in yarn_sets], [(y.point_count,) for y in yarn_sets], 0.0),
        surface_uv=_joined(
            [yarns.surface_uv for yarns in yarn_sets], [(y.point_count, 2) for y in yarn_sets], 0.0
        ),
        row=_joined([yarns.row for yarns in yarn_sets], [(y.yarn_count,) for y in yarn_sets], 0),
    )


def rows_within_types(yarn_type: np.ndarray) -> np.ndarray:
    """How many yarns of the same type come before each, int64."""
    rows = np.empty(len(yarn_type), np.int64)
    for kind in np.unique(yarn_type):
        own = yarn_type == kind
        rows[own] = np.arange(own.sum())
    return rows


def refuse_too_many_points(count: int, what: str, *, path: str | Path | None = None) -> None:
    """Raise before allocating more control points than `MAX_POINTS`."""
    if count > MAX_POINTS:
        raise InputError(f"{what} would have {count:,} control points; at most {MAX_POINTS:,} fit", path=path)


def _joined(
    parts: list[np.ndarray | None], shapes: Sequence[tuple[int, ...]], fill: float
) -> np.ndarray | None:
    """Concatenate optional arrays; None where nobody has one, `fill` where only some do."""
    if all(part is None for part in parts):
        return None
    return np.concatenate(
        [np.full(shape, fill) if part is None else part for part, shape in zip(parts, shapes, strict=True)]
    )


def _normalize_dtypes(yarns: YarnSet) -> None:
    """Store every field with the dtype that its docstring promises."""
    dtypes = {
        "points": np.float64,
        "offsets": np.int64,
        "closed": np.bool_,
        "radius": np.float64,
        "yarn_type": np.int32,
        "twist": np.float64,
        "surface_uv": np.float64,
        "row": np.int64,
    }
    for name, dtype in dtypes.items():
        value = getattr(yarns, name)
        if value is not None:
            object.__setattr__(yarns, name, np.ascontiguousarray(value, dtype=dtype))
    object.__setattr__(yarns, "type_names", tuple(str(name) for name in yarns.type_names))


def _check_shapes(yarns: YarnSet) -> None:
    """Refuse arrays whose shapes do not fit each other."""
    points, offsets = yarns.points, yarns.offsets
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"yarn points have shape {list(points.shape)}; need [point_count, 3]")
    if offsets.ndim != 1 or len(offsets) < 2:
        raise InputError("there are no yarns; need at least one")
    if offsets[0] != 0 or offsets[-1] != len(points) or (np.diff(offsets) < 0).any():
        raise InputError(f"yarn offsets must rise from 0 to the number of points, {len(points)}")
    expected: dict[str, tuple[int, ...]] = {
        "closed": (yarns.yarn_count,),
        "radius": (yarns.yarn_count,),
        "yarn_type": (yarns.yarn_count,),
        "twist": (len(points),),
        "surface_uv": (len(points), 2),
        "row": (yarns.yarn_count,),
    }
    for name, shape in expected.items():
        value = getattr(yarns, name)
        if value is not None and value.shape != shape:
            raise InputError(f"{name} has shape {list(value.shape)}; need {list(shape)}")


def _check_values(yarns: YarnSet) -> None:
    """Refuse centerlines that are too short, not finite or without extent, and radii that are no radii."""
    counts = yarns.point_counts
    _refuse_first(
        counts < MIN_POINTS,
        lambda y: f"yarn {y} has {_points(int(counts[y]))}; a centerline needs at least {MIN_POINTS}",
    )
    bad_points = ~(np.abs(yarns.points) <= MAX_COORDINATE_MM).all(axis=1)
    for name in ("twist", "surface_uv"):
        value = getattr(yarns, name)
        if value is not None:
            bad_points |= ~np.isfinite(value.reshape(len(bad_points), -1)).all(axis=1)
    _refuse_first(bad_points, lambda p: _describe_bad_point(yarns, p))
    _refuse_first(
        ~(np.isfinite(yarns.radius) & (yarns.radius > 0)),
        lambda y: f"yarn {y} has radius {yarns.radius[y]:g} mm; need a positive number",
    )
    _refuse_first(
        (yarns.yarn_type < 0) | (yarns.yarn_type >= len(yarns.type_names)),
        lambda y: f"yarn {y} has type {yarns.yarn_type[y]}, but there are {len(yarns.type_names)} type names",
    )
    for name in yarns.type_names:
        if not re.fullmatch(TYPE_NAME, name):
            raise InputError(f"{name!r} is no name of a yarn type; need letters, digits and _, at most 32")
    low = np.minimum.reduceat(yarns.points, yarns.offsets[:-1])
    high = np.maximum.reduceat(yarns.points, yarns.offsets[:-1])
    _refuse_first((low == high).all(axis=1), lambda y: f"yarn {y} has no length: all its points coincide")


def _describe_bad_point(yarns: YarnSet, point: int) -> str:
    """Name the yarn and the point whose coordinates, twist or (u, v) cannot be used."""
    yarn = int(np.searchsorted(yarns.offsets, point, side="right")) - 1
    where = f"yarn {yarn}, point {point - yarns.offsets[yarn]}"
    coordinates = ", ".join(f"{value:g}" for value in yarns.points[point])
    if not np.isfinite(yarns.points[point]).all():
        return f"{where} is not finite: ({coordinates}) mm"
    if np.abs(yarns.points[point]).max() > MAX_COORDINATE_MM:
        return f"{where} lies at ({coordinates}) mm, beyond ten kilometers; check the unit"
    return f"{where} has a twist or (u, v) that is not finite"


def _points(count: int) -> str:
    return f"{count} control point" + "s" * (count != 1)


def _refuse_first(bad: np.ndarray, describe: Any) -> None:
    """Raise for the first true entry of `bad`."""
    if bad.any():
        raise InputError(describe(int(np.argmax(bad))))
