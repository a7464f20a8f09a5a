"""Weaves from a draft, with the crimp geometry of Peirce 1937, "The geometry of cloth structure".

Warp yarns run along y, weft yarns along x, z points out of the face. Where two yarns cross, their centers
are R apart, R the sum of the radii, shared between them as crimp. Between two crossings a yarn either
floats or goes from one face to the other. Peirce lets it hug both yarns that it passes, in arcs of radius
R, with a straight line between. Here the arcs are as wide as the space allows and meet in the middle, which
bends the yarn least; their radius is at least R wherever the yarns have room to cross at all.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from weft.fiber_model.yarns.yarns import YarnSet, refuse_too_many_points
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


def weave_yarns(
    size_mm: tuple[float, float],
    *,
    draft: Draft,
    warp_per_cm: float,
    weft_per_cm: float,
    warp_radius_mm: float,
    weft_radius_mm: float,
    warp_crimp: float | None = None,
    type_names: tuple[str, ...] = ("yarn",),
    progress: Callable[[float, str], None] | None = None,
) -> YarnSet:
    """A woven rectangle around the origin. With two `type_names` warp and weft are of different types.

    `warp_crimp` is the warp's share of the crimp in [0, 1]; None takes the possible share nearest to a half.
    """
    pattern = draft_matrix(draft)
    refuse_loose_yarns(pattern)
    warp = YarnSystem(max(round(size_mm[0] * warp_per_cm / 10), 1), 10 / warp_per_cm, warp_radius_mm)
    weft = YarnSystem(max(round(size_mm[1] * weft_per_cm / 10), 1), 10 / weft_per_cm, weft_radius_mm)
    refuse_too_many_points(2 * POINTS_PER_CROSSING * warp.count * weft.count, "yarns.size_mm: this weave")
    _refuse_touching(warp, "warp")
    _refuse_touching(weft, "weft")
    warp_height, weft_height = crimp_heights(pattern, warp, weft, warp_crimp)
    on_top = _warp_on_top(pattern, warp.count, weft.count)
    warps = _crimped_yarns(on_top.T, warp, weft.spacing, warp_height)[..., [1, 0, 2]]
    if progress is not None:
        progress(0.5, f"{warp.count} warp yarns")
    wefts = _crimped_yarns(~on_top, weft, warp.spacing, weft_height)
    types = [0] * warp.count + [len(type_names) - 1] * weft.count
    return YarnSet.checked(
        [*warps, *wefts],
        radius=[warp.radius] * warp.count + [weft.radius] * weft.count,
        yarn_type=types,
        type_names=type_names,
    )


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


def _warp_on_top(pattern: np.ndarray, warp_count: int, weft_count: int) -> np.ndarray:
    """The draft repeated over the cloth and one crossing beyond each edge, shape [weft + 2, warp + 2].

    Row 0 lies at the bottom, y being up.
    """
    rows, columns = np.arange(-1, weft_count + 1), np.arange(-1, warp_count + 1)
    return pattern[::-1][np.ix_(rows % pattern.shape[0], columns % pattern.shape[1])]


def _crimped_yarns(up: np.ndarray, system: YarnSystem, spacing: float, height: float) -> np.ndarray:
    """Centerlines [mm] of one system, running along x, shape [yarn_count, n, 3].

    `up` says where each yarn lies on the face, bool, shape [yarn_count + 2, crossings + 2], including one
    crossing beyond each edge; `spacing` [mm] is that of the crossings.
    """
    up = up[1:-1]
    intervals = up.shape[1] - 1
    profile = change_of_face(spacing, height, POINTS_PER_CROSSING)[:-1]
    float_along = np.arange(POINTS_PER_CROSSING) * (spacing / POINTS_PER_CROSSING)
    changes = (up[:, 1:] != up[:, :-1])[..., None]
    along = np.where(changes, profile[:, 0], float_along)
    lift = np.where(changes, profile[:, 1], height)
    start = (np.arange(intervals) - 0.5 * intervals) * spacing
    x = (along + start[:, None]).reshape(len(up), -1)
    z = (lift * np.where(up[:, :-1], 1.0, -1.0)[..., None]).reshape(len(up), -1)
    y = np.broadcast_to(system.places[:, None], x.shape)
    half = POINTS_PER_CROSSING // 2  # the cloth ends halfway to the crossings beyond its edge
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
