"""Weaves from a draft, with the crimp geometry of Peirce 1937, "The geometry of cloth structure".

Warp yarns run along y, weft yarns along x, z points out of the face. Where two yarns cross, their centers
are R apart, R the sum of the radii, shared between them as crimp. Between two crossings a yarn either
floats or goes from one face to the other. Peirce lets it hug both yarns that it passes, in arcs of radius
R, with a straight line between. Here the arcs are as wide as the space allows and meet in the middle, which
bends the yarn least; their radius is at least R wherever the yarns have room to cross at all.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from weft.fiber_model.yarns.groups import GROUP_POINTS
from weft.fiber_model.yarns.yarns import MAX_POINTS, YarnSet, refuse_too_many_points
from weft.files.errors import InputError

from .drafts import Draft, draft_matrix, refuse_loose_yarns

POINTS_PER_CROSSING = 16
"""Control points between two crossings; even, so that yarns can end halfway."""


@dataclass(frozen=True)
class YarnSystem:
    """One of the two sets of parallel yarns."""

    count: int
    """Number of yarns."""
    spacing: float
    """Distance between neighbors [mm]."""
    radius: float
    """Yarn radius [mm]."""

    @property
    def places(self) -> np.ndarray:
        """Coordinate of each yarn across its direction [mm], around 0."""
        return (np.arange(self.count) - 0.5 * (self.count - 1)) * self.spacing


@dataclass(frozen=True)
class Weave:
    """A woven rectangle worked out, any of whose yarns can then be made alone."""

    warp: YarnSystem
    weft: YarnSystem
    pattern: np.ndarray
    """Where the warp lies on the face, bool, top row first; it repeats over the cloth."""
    heights: tuple[float, float]
    """How far warp and weft swing from the middle of the cloth [mm]."""
    points_per_crossing: int

    @classmethod
    def planned(
        cls,
        size_mm: tuple[float, float],
        *,
        draft: Draft,
        warp_per_cm: float,
        weft_per_cm: float,
        warp_radius_mm: float,
        weft_radius_mm: float,
        warp_crimp: float | None = None,
        points_per_crossing: int = POINTS_PER_CROSSING,
    ) -> Weave:
        """Count the yarns and share the crimp; refuses what cannot be woven."""
        pattern = draft_matrix(draft)
        refuse_loose_yarns(pattern)
        warp = YarnSystem(max(round(size_mm[0] * warp_per_cm / 10), 1), 10 / warp_per_cm, warp_radius_mm)
        weft = YarnSystem(max(round(size_mm[1] * weft_per_cm / 10), 1), 10 / weft_per_cm, weft_radius_mm)
        _refuse_touching(warp, "warp")
        _refuse_touching(weft, "weft")
        heights = crimp_heights(pattern, warp, weft, warp_crimp)
        return cls(warp, weft, pattern, heights, points_per_crossing)

    @property
    def point_count(self) -> int:
        """Control points of all yarns."""
        return 2 * self.points_per_crossing * self.warp.count * self.weft.count

    def warps(self, rows: range) -> np.ndarray:
        """Centerlines [mm] of some warp yarns, counted from the left, shape [row_count, n, 3]."""
        up, height = _warp_on_top(self.pattern, rows, range(self.weft.count)).T, self.heights[0]
        along_x = _crimped_yarns(
            up, self.warp.places[rows.start : rows.stop], self.weft.spacing, height, self.points_per_crossing
        )
        return along_x[..., [1, 0, 2]]

    def wefts(self, rows: range) -> np.ndarray:
        """Centerlines [mm] of some weft yarns, counted from below, shape [row_count, n, 3]."""
        up, height = ~_warp_on_top(self.pattern, range(self.warp.count), rows), self.heights[1]
        return _crimped_yarns(
            up, self.weft.places[rows.start : rows.stop], self.warp.spacing, height, self.points_per_crossing
        )


def weave_yarns(
    size_mm: tuple[float, float],
    *,
    type_names: tuple[str, ...] = ("yarn",),
    progress: Callable[[float, str], None] | None = None,
    **options: Any,
) -> YarnSet:
    """A woven rectangle around the origin. With two `type_names` warp and weft are of different types.

    `options` are those of `Weave.planned`. `warp_crimp` is the warp's share of the crimp in [0, 1]; None
    takes the possible share nearest to a half.
    """
    weave = Weave.planned(size_mm, **options)
    refuse_too_many_points(weave.point_count, "yarns.size_mm: this weave")
    warp, weft = weave.warp, weave.weft
    warps = weave.warps(range(warp.count))
    if progress is not None:
        progress(0.5, f"{warp.count} warp yarns")
    return YarnSet.checked(
        [*warps, *weave.wefts(range(weft.count))],
        radius=[warp.radius] * warp.count + [weft.radius] * weft.count,
        yarn_type=[0] * warp.count + [len(type_names) - 1] * weft.count,
        type_names=type_names,
    )


def weave_parts(
    size_mm: tuple[float, float],
    *,
    type_names: tuple[str, ...] = ("yarn",),
    within: np.ndarray | None = None,
    **options: Any,
) -> Iterator[YarnSet]:
    """The yarns of `weave_yarns` in their order, a few at a time, with their numbers as `row`.

    Of `within` [mm], shape [2, 2], only yarns that lie between its sides are made.
    """
    weave = Weave.planned(size_mm, **options)
    sides = np.full((2, 2), np.inf) * [[-1], [1]] if within is None else within
    warps, wefts = (
        _rows_between(system, side) for system, side in zip((weave.warp, weave.weft), sides.T, strict=True)
    )
    points = weave.points_per_crossing * np.array([weave.weft.count, weave.warp.count])
    _refuse_too_many_in_parts(int(points @ [len(warps), len(wefts)]))
    first_weft = weave.warp.count if len(type_names) == 1 else 0
    yield from _parts(weave.warps, warps, int(points[0]), weave.warp.radius, 0, type_names, 0)
    kind = len(type_names) - 1
    yield from _parts(weave.wefts, wefts, int(points[1]), weave.weft.radius, kind, type_names, first_weft)


def _parts(
    make: Callable[[range], np.ndarray],
    rows: range,
    points: int,
    radius: float,
    kind: int,
    type_names: tuple[str, ...],
    first_number: int,
) -> Iterator[YarnSet]:
    """Yarns of one system, each of so many points, a few at a time."""
    size = max(GROUP_POINTS // points, 1)
    for begin in range(rows.start, rows.stop, size):
        own = range(begin, min(begin + size, rows.stop))
        yarns = YarnSet.checked(list(make(own)), radius=radius, yarn_type=kind, type_names=type_names)
        yield replace(yarns, row=first_number + np.arange(own.start, own.stop))


def _rows_between(system: YarnSystem, sides: np.ndarray) -> range:
    """The yarns that lie between two places [mm]."""
    first, stop = (
        np.searchsorted(system.places, sides[0]),
        np.searchsorted(system.places, sides[1], side="right"),
    )
    return range(int(first), int(stop))


def _refuse_too_many_in_parts(count: int) -> None:
    """Of a rectangle most of which may be cut away; what is left is counted when it is laid."""
    most = 8 * MAX_POINTS
    if count > most:
        found = f"this weave would have {count:,} control points in the rectangle around its cloth"
        raise InputError(f"{found}; at most {most:,} are tried", place="yarns.pattern")


def crimp_heights(
    pattern: np.ndarray, warp: YarnSystem, weft: YarnSystem, warp_crimp: float | None
) -> tuple[float, float]:
    """How far warp and weft centerlines swing from the middle of the cloth [mm]; together the sum of radii.

    A yarn changes faces between two neighbors of the other system. They leave room only if their centers, one
    up and one down, are twice the sum of radii apart (Peirce's jamming): spacing^2 + (2 height)^2 >= (2 R)^2.
    """
    reach = warp.radius + weft.radius
    warp_changes = bool((pattern != np.roll(pattern, 1, axis=0)).any())
    weft_changes = bool((pattern != np.roll(pattern, 1, axis=1)).any())
    least_weft = _jamming_height(weft.spacing, reach) if warp_changes else 0.0
    least_warp = _jamming_height(warp.spacing, reach) if weft_changes else 0.0
    if least_warp + least_weft > reach:
        raise InputError(_too_dense(warp, weft, reach), place="yarns.weft_per_cm")
    low, high = least_warp / reach, 1 - least_weft / reach
    share = float(np.clip(0.5, low, high)) if warp_crimp is None else warp_crimp
    if not low - 1e-9 <= share <= high + 1e-9:
        what = f"a warp share of {share:g} makes yarns intersect"
        raise InputError(
            f"{what}; at these counts it must lie in [{low:.3g}, {high:.3g}]", place="yarns.warp_crimp"
        )
    return share * reach, (1 - share) * reach


def _jamming_height(spacing: float, reach: float) -> float:
    return float(np.sqrt(max(reach**2 - 0.25 * spacing**2, 0.0)))


def _too_dense(warp: YarnSystem, weft: YarnSystem, reach: float) -> str:
    """Message that says how few weft yarns this warp allows."""
    height = reach - _jamming_height(warp.spacing, reach)
    spacing = 2 * np.sqrt(reach**2 - height**2)
    found = f"{10 / warp.spacing:g} warp and {10 / weft.spacing:g} weft yarns per cm"
    radii = f"radii {warp.radius:g} and {weft.radius:g} mm"
    most = f"beside this warp at most {np.floor(100 / spacing) / 10:g} weft yarns per cm fit"
    return f"{found} of {radii} cannot cross without intersecting; {most}"


def _refuse_touching(system: YarnSystem, name: str) -> None:
    """Refuse neighbors closer than their diameter."""
    if system.spacing < 2 * system.radius * (1 - 1e-9):
        found = f"{10 / system.spacing:g} yarns per cm leave {system.spacing:.3g} mm for each"
        what = f"{found}, less than its diameter of {2 * system.radius:.3g} mm."
        hint = f"At this radius at most {5 / system.radius:.3g} fit."
        raise InputError(what, place=f"yarns.{name}_per_cm", hint=hint)


def _warp_on_top(pattern: np.ndarray, warps: range, wefts: range) -> np.ndarray:
    """The draft over some of the cloth and one crossing beyond each edge, shape [weft + 2, warp + 2].

    Row 0 lies at the bottom, y being up.
    """
    rows, columns = np.arange(wefts.start - 1, wefts.stop + 1), np.arange(warps.start - 1, warps.stop + 1)
    return pattern[::-1][np.ix_(rows % pattern.shape[0], columns % pattern.shape[1])]


def _crimped_yarns(
    up: np.ndarray, places: np.ndarray, spacing: float, height: float, count: int
) -> np.ndarray:
    """Centerlines [mm] of yarns that run along x at `places`, shape [yarn_count, n, 3].

    `up` says where each yarn lies on the face, bool, shape [yarn_count + 2, crossings + 2], including one
    crossing beyond each edge; `spacing` [mm] is that of the crossings, with `count` points between two.
    """
    up = up[1:-1]
    intervals = up.shape[1] - 1
    profile = change_of_face(spacing, height, count)[:-1]
    float_along = np.arange(count) * (spacing / count)
    changes = (up[:, 1:] != up[:, :-1])[..., None]
    along = np.where(changes, profile[:, 0], float_along)
    lift = np.where(changes, profile[:, 1], height)
    start = (np.arange(intervals) - 0.5 * intervals) * spacing
    x = (along + start[:, None]).reshape(len(up), -1)
    z = (lift * np.where(up[:, :-1], 1.0, -1.0)[..., None]).reshape(len(up), -1)
    y = np.broadcast_to(places[:, None], x.shape)
    half = count // 2  # the cloth ends halfway to the crossings beyond its edge
    return np.stack([x, y, z], axis=2)[:, half : x.shape[1] - half + 1]


def change_of_face(spacing: float, height: float, count: int) -> np.ndarray:
    """Points (along, z) [mm] from (0, height) to (spacing, -height), evenly spaced, shape [count + 1, 2].

    Two equal arcs, flat at the ends and meeting in the middle; their radius is (spacing^2 / 4 + height^2) /
    (2 height).
    """
    slope = 2 * np.arctan2(2 * height, spacing)
    turned = slope * np.linspace(0, 1, count // 2 + 1)
    if slope > 0:
        radius = 0.5 * spacing / np.sin(slope)
        first = np.stack([radius * np.sin(turned), height - radius * (1 - np.cos(turned))], axis=1)
    else:
        first = np.stack([np.linspace(0, 0.5 * spacing, count // 2 + 1), 0 * turned], axis=1)
    second = np.array([spacing, 0.0]) - first[::-1]
    return np.concatenate([first, second[1:]])
