"""Stitch charts: which stitch each wale has in each course, and which wales cross over, by name or as text.

A chart is read as seen on the face, the top row first; the bottom row is knit first, and the whole repeats
in both directions. A row is a text of marks: `k` (knit), `p` (purl), and cables such as `c4f` or `c4b`,
which span as many wales as they say. A number after k or p repeats it: `p2 c4f p2` spans eight wales.
In `c4f` two stitches are held in front and the next two are worked before them: seen on the face, the two
right wales move to the left in front of the others. In `c4b` they move behind, and the two left wales come
to lie in front, leaning right.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from weft.files.errors import InputError

MARK = re.compile(r"([kp])([1-9][0-9]?)?$|c([2468])([fb])$")
MAX_STITCHES = 1024
"""Most stitches of one repeat: relaxing them takes a minute or two."""


@dataclass(frozen=True)
class Crossing:
    """Wales first .. first + 2 half - 1 change sides below the stitches of one course."""

    course: int
    first: int
    half: int
    """Wales on each side."""
    left_leaning: bool
    """Whether those that go from right to left pass in front (`f`), or those from left to right (`b`)."""


@dataclass(frozen=True)
class StitchChart:
    """One repeat of a knit."""

    knit: np.ndarray
    """True for a knit stitch, false for a purl, bool, shape [courses, wales]; the lowest course first."""
    crossings: tuple[Crossing, ...] = ()

    @property
    def courses(self) -> int:
        """Courses of the repeat."""
        return len(self.knit)

    @property
    def wales(self) -> int:
        """Wales of the repeat."""
        return self.knit.shape[1]

    def at_least(self, count: int) -> StitchChart:
        """The chart repeated until it has `count` wales and courses."""
        up, across = -(-count // self.courses), -(-count // self.wales)
        crossings = [
            replace(
                crossing, course=crossing.course + i * self.courses, first=crossing.first + j * self.wales
            )
            for crossing in self.crossings
            for i in range(up)
            for j in range(across)
        ]
        return StitchChart(np.tile(self.knit, (up, across)), tuple(crossings))


NAMED_CHARTS = {
    "stockinette": ("k",),
    "reverse_stockinette": ("p",),
    "garter": ("p", "k"),
    "rib_1_1": ("k p",),
    "rib_2_2": ("k2 p2",),
    "seed": ("p k", "k p"),
    "cable_4_front": ("p2 k4 p2", "p2 k4 p2", "p2 c4f p2", "p2 k4 p2", "p2 k4 p2", "p2 k4 p2"),
    "cable_4_back": ("p2 k4 p2", "p2 k4 p2", "p2 c4b p2", "p2 k4 p2", "p2 k4 p2", "p2 k4 p2"),
}
"""Charts by name."""


def read_chart(chart: str | Sequence[str]) -> StitchChart:
    """A chart by its name, or from its rows of text."""
    rows = NAMED_CHARTS[chart] if isinstance(chart, str) else chart
    signs, crossings = [], []
    for course, row in enumerate(reversed(rows)):
        knit, crossed = _read_row(row, course)
        signs.append(knit)
        crossings += crossed
    widths = [len(knit) for knit in signs]
    if len(set(widths)) != 1:
        spans = ", ".join(map(str, reversed(widths))) or "no"
        raise _wrong(f"its rows span {spans} wales; all must span the same")
    if not 1 <= sum(widths) <= MAX_STITCHES:
        raise _wrong(f"it has {sum(widths):,} stitches; need 1 to {MAX_STITCHES:,}")
    return StitchChart(np.array(signs), tuple(crossings))


def _read_row(row: str, course: int) -> tuple[list[bool], list[Crossing]]:
    knit: list[bool] = []
    crossings = []
    for mark in row.lower().split():
        found = MARK.match(mark)
        if found is None:
            raise _wrong(f"found '{mark}' in '{row}'; known are k, p, k3, p3, c2f to c8f, and c2b to c8b")
        stitch, repeats, span, side = found.groups()
        if stitch:
            knit += [stitch == "k"] * int(repeats or 1)
        else:
            crossings.append(Crossing(course, len(knit), int(span) // 2, left_leaning=side == "f"))
            knit += [True] * int(span)
    return knit, crossings


def _wrong(what: str) -> InputError:
    return InputError(f"the stitch chart cannot be knit: {what}", place="yarns.chart")
