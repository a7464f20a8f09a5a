"""The part of a large set of curves that a picture can hold: the middle of it, and a line that says so."""

from __future__ import annotations

import numpy as np

from weft.files.errors import InputError

TUBE_POINTS = 1_000_000
"""Points of all tubes of one panel: about a gigabyte while it is drawn."""


def middle_cube(points: np.ndarray, budget: int) -> np.ndarray:
    """The largest cube, around the point nearest to the middle, that holds at most `budget` points.

    Shape [2, 3]. A cube rather than the shape of the whole: of flat cloth it takes the full thickness.
    """
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    center = points[np.argmin(np.abs(points - middle).max(axis=1))]
    distance = np.abs(points - center).max(axis=1)
    half = float(np.partition(distance, budget)[budget])
    return np.stack([center - half, center + half]).astype(np.float64)


def cut_to_box(points: np.ndarray, offsets: np.ndarray, box: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the points of segments wholly inside the open box, and where the pieces begin.

    A curve that leaves and returns becomes two pieces.
    """
    inside = ((points > box[0]) & (points < box[1])).all(axis=1)
    last = np.zeros(len(points), bool)
    last[offsets[1:] - 1] = True
    kept = inside[:-1] & inside[1:] & ~last[:-1]  # segment from point i to i + 1
    before, after = np.append(False, kept), np.append(kept, False)
    chosen = before | after
    begins = np.flatnonzero((after & ~before)[chosen])
    return np.flatnonzero(chosen), np.append(begins, chosen.sum()).astype(np.int64)


def without_repeats(points: np.ndarray, offsets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Indices of points that differ from the one before, and offsets; tubes need a direction at each."""
    first = np.zeros(len(points), bool)
    first[offsets[:-1][np.diff(offsets) > 0]] = True
    moved = np.append(True, (points[1:] != points[:-1]).any(axis=1))
    kept = first | moved
    sums = np.concatenate([[0], np.cumsum(kept)])
    counts = sums[offsets[1:]] - sums[offsets[:-1]]
    long = counts > 1
    kept &= np.repeat(long, np.diff(offsets))
    return np.flatnonzero(kept), np.concatenate([[0], np.cumsum(counts[long])]).astype(np.int64)


def chosen_part(
    points: np.ndarray,
    offsets: np.ndarray,
    box: np.ndarray | None,
    *,
    what: str,
    budget: int | None = None,
    total: int | None = None,
) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Points and offsets of what can be shown, within `box` if given, and a note where that is not all.

    `total` is the number of points that there are, where `points` are a part of them already.
    """
    budget = TUBE_POINTS if budget is None else budget
    total = len(points) if total is None else total
    index, kept_offsets = np.arange(len(points)), offsets
    notes: tuple[str, ...] = ()
    if box is not None:
        index, kept_offsets = cut_to_box(points, offsets, box)
        if not len(index):
            raise InputError(
                f"--box: no {what} lies in it; they lie within {box_text(bounds_of(points))}",
            )
        notes = (f"part: {box_text(box)}, {_share(len(index), total)} of the {what}",)
    if len(index) > budget:
        cube = middle_cube(points[index], budget)
        inner, kept_offsets = cut_to_box(points[index], kept_offsets, cube)
        index = index[inner]
        notes = (
            f"part only, too many {what} for one picture: {box_text(cube)}, "
            f"{_share(len(index), total)} of the {what}; --box chooses another",
        )
    apart, final = without_repeats(points[index], kept_offsets)
    return index[apart], final, notes


def bounds_of(points: np.ndarray) -> np.ndarray:
    """Lowest and highest corner, shape [2, 3]."""
    return np.stack([points.min(axis=0), points.max(axis=0)]).astype(np.float64)


def box_text(box: np.ndarray) -> str:
    """`x -1..2, y 0..3, z 0..1 mm`."""
    spans = (f"{name} {low:.3g}..{high:.3g}" for name, low, high in zip("xyz", *box, strict=True))
    return ", ".join(spans) + " mm"


def _share(part: int, whole: int) -> str:
    return f"{100 * part / whole:.2g} %"
