"""Fibers as tubes of their radius, in their own colors where they have some.

Else colored by ply; loops and hairs, the fly-aways, in colors of their own.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from weft.fiber_model.fiber_curves import (
    HAIR,
    LOOP,
    FiberCurves,
    FiberSelection,
    export_curves,
    select_stretches,
)
from weft.files.errors import InputError

from . import part
from .scene import (
    HAIR_COLOR,
    LOOP_COLOR,
    Color,
    Scene,
    Tubes,
    count_text,
    length_text,
    palette_color,
    size_text,
)

if TYPE_CHECKING:
    from weft.fiber_model.fibers import FiberSet

MADE_POINTS = 6_000_000
"""Points that are made of a job's fibers, of which the picture then takes the middle."""
MANY_POINTS = 150_000
"""From here on tubes have 5 sides in place of 8."""


def fiber_scene(
    name: str,
    curves: FiberCurves,
    *,
    box: np.ndarray | None = None,
    total: int | None = None,
) -> Scene:
    """All curves, or the part of them within `box`; `total` is the number of points they were taken from."""
    if not curves.curve_count:
        raise InputError(f"{name}: there are no fibers to show")
    index, offsets, notes = part.chosen_part(curves.points, curves.offsets, box, what="fibers", total=total)
    curve = np.searchsorted(curves.offsets, index, side="right") - 1
    tubes = Tubes(
        points=curves.points[index],
        offsets=offsets,
        radius=curves.fiber_radius_mm[curve[offsets[:-1]]],
        color=_colors_of(curves, curve, index),
        sides=8 if len(index) < MANY_POINTS else 5,
    )
    bounds = part.bounds_of(tubes.points)
    return Scene(
        kind="fibers",
        title=f"{name}: {_summary(tubes, curves.kind[index])}, {size_text(bounds)}",
        layers=(tubes,),
        bounds=bounds,
        notes=notes,
        legend=_legend(curves.ply[curve], curves.kind[index])
        if curves.color is None
        else _legend_of_own(curves.ply[curve], tubes.color),
    )


def _colors_of(curves: FiberCurves, curve: np.ndarray, index: np.ndarray) -> np.ndarray:
    """The fibers' own colors where they have some, else colors that tell plies and fly-aways apart."""
    if curves.color is None:
        return point_colors(curves.ply[curve], curves.kind[index])
    return own_colors(curves.color[index])


def own_colors(linear: np.ndarray) -> np.ndarray:
    """Linear RGB, shape [n, 3], as the levels of a screen, uint8; what is above 1 is cut."""
    from weft.renderer.image import srgb

    return np.round(255.0 * srgb(linear)).astype(np.uint8)


def point_colors(ply: np.ndarray, kind: np.ndarray) -> np.ndarray:
    """Color of each point by its ply and its kind, uint8, shape [n, 3]."""
    plies = np.array([palette_color(i) for i in range(max(int(ply.max(initial=0)) + 1, 1))], np.uint8)
    color = plies[np.maximum(ply, 0)]
    color[kind == LOOP] = LOOP_COLOR
    color[kind == HAIR] = HAIR_COLOR
    return color


def job_fiber_scene(
    name: str, fibers: FiberSet, selection: FiberSelection, *, box: np.ndarray | None = None
) -> Scene:
    """The part of a job's fibers that its [export] chooses, or `box`, or the middle."""
    if box is not None:
        low, high = box.tolist()
        selection = replace(selection, box_mm=(tuple(low), tuple(high)))
    bounded, total = bounded_selection(fibers, selection)
    curves = export_curves(fibers, bounded)
    if not curves.curve_count:
        raise InputError("no fiber lies in this part", hint="Give another --box, or change [export].")
    scene = fiber_scene(name, curves, total=total)
    notes = scene.notes
    if bounded != selection and not notes:
        chosen = part.box_text(np.array(bounded.box_mm))
        notes = (f"part only, {total:,} points of fiber are too many: {chosen}; --box chooses another",)
    if selection != FiberSelection():
        notes = (f"of the part that {'--box' if box is not None else '[export]'} chooses", *notes)
    return replace(scene, notes=notes)


def bounded_selection(
    fibers: FiberSet, selection: FiberSelection, *, budget: int | None = None
) -> tuple[FiberSelection, int]:
    """The selection, or where it has more points than `budget` a cube in its middle; and its points."""
    budget = MADE_POINTS if budget is None else budget
    chosen = select_stretches(fibers, selection)
    counts = fibers.stretch_point_counts()[chosen]
    total = int(counts.sum())
    if total <= budget:
        return selection, total
    bounds = fibers.stretch_bounds()[chosen].astype(np.float64)
    centers = bounds.mean(axis=1)
    middle = 0.5 * (centers.min(axis=0) + centers.max(axis=0))
    center = centers[np.argmin(np.abs(centers - middle).max(axis=1))]
    reach = np.maximum(bounds[:, 0] - center, center - bounds[:, 1]).max(axis=1).clip(0.0)
    order = np.argsort(reach, kind="stable")
    half = float(reach[order[np.searchsorted(np.cumsum(counts[order]), budget, side="right")]])
    half = max(half * (1 - 1e-6), 4 * max(fibers.fiber_radius_mm))
    low, high = center - half, center + half
    if selection.box_mm is not None:
        low, high = np.maximum(low, selection.box_mm[0]), np.minimum(high, selection.box_mm[1])
    return replace(selection, box_mm=(tuple(low.tolist()), tuple(high.tolist()))), total


def _summary(tubes: Tubes, kind: np.ndarray) -> str:
    """Counts of curves and their length; a curve that the box cut into pieces counts once for each."""
    hairs = int((kind[tubes.offsets[:-1]] == HAIR).sum())
    step = np.linalg.norm(np.diff(tubes.points.astype(np.float64), axis=0), axis=1)
    step[tubes.offsets[1:-1] - 1] = 0.0  # from one curve to the next
    bodies = count_text(tubes.curve_count - hairs, "fiber")
    return f"{bodies} and {count_text(hairs, 'hair')}, {length_text(float(step.sum()))}"


def _legend(ply: np.ndarray, kind: np.ndarray) -> tuple[tuple[str, Color], ...]:
    """Plies and fly-aways that are there."""
    plies = np.unique(ply[(ply >= 0) & (kind != HAIR)])
    entries = [(f"ply {int(i) + 1}", palette_color(int(i))) for i in plies]
    if (kind == LOOP).any():
        entries.append(("loop fly-aways", LOOP_COLOR))
    if (kind == HAIR).any():
        entries.append(("hair fly-aways", HAIR_COLOR))
    return tuple(entries)


def _legend_of_own(ply: np.ndarray, color: np.ndarray) -> tuple[tuple[str, Color], ...]:
    """The plies that are there in the middle of their colors, which may vary along the yarn."""
    entries = []
    for i in np.unique(ply[ply >= 0]).tolist():
        red, green, blue = np.median(color[ply == i], axis=0).astype(int).tolist()
        entries.append((f"ply {i + 1}", (red, green, blue)))
    return tuple(entries)
