"""Weave drafts: which yarn lies on top at each crossing, by name, as text, or as a matrix.

Rows are wefts, columns warps, the top row first as seen on the face; true where the warp lies on top.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from weft.files.errors import InputError

Draft = str | Sequence[str] | Sequence[Sequence[int]] | np.ndarray


def twill(over: int, under: int) -> np.ndarray:
    """A twill whose lines rise to the right."""
    count = over + under
    column, row = np.meshgrid(np.arange(count), np.arange(count)[::-1])
    return (column - row) % count < over


def broken_twill(over: int, under: int) -> np.ndarray:
    """A twill of four whose third and fourth warps are exchanged, so that no line runs through."""
    return twill(over, under)[:, [0, 1, 3, 2]]


def herringbone(width: int) -> np.ndarray:
    """2/2 twill in stripes of `width` warps (a multiple of 4), rising and falling in turn.

    Where stripes meet, neighbors are each other's opposite: the clean break of herringbone, where a pointed
    twill would float over three.
    """
    rising = np.arange(width) % 4
    return twill(2, 2)[:, np.concatenate([rising, (1 - rising) % 4])]


def satin(ends: int, step: int) -> np.ndarray:
    """A warp-faced satin: a weft passes over one warp in `ends`, `step` further in the next row."""
    column, row = np.meshgrid(np.arange(ends), np.arange(ends)[::-1])
    return column != (step * row) % ends


def basket(count: int) -> np.ndarray:
    """Plain weave of groups of `count` warps and `count` wefts."""
    return np.kron(twill(1, 1), np.ones((count, count), bool))


NAMED_DRAFTS = {
    "plain": twill(1, 1),
    "twill_2_1": twill(2, 1),
    "twill_3_1": twill(3, 1),
    "twill_2_2": twill(2, 2),
    "broken_twill_3_1": broken_twill(3, 1),
    "broken_twill_2_2": broken_twill(2, 2),
    "herringbone_2_2": herringbone(8),
    "satin_5": satin(5, 2),
    "satin_8": satin(8, 3),
    "basket_2_2": basket(2),
}
"""Drafts by name, bool."""


def draft_matrix(draft: Draft) -> np.ndarray:
    """A draft as bool, shape [weft rows, warp columns].

    It may be a name, rows of text with 'x' where the warp is on top and '.', or rows of 1 and 0.
    """
    if isinstance(draft, str):
        return NAMED_DRAFTS[draft]
    if len({len(row) for row in draft}) != 1 or len(draft[0]) == 0:
        raise InputError("the rows of a draft must be equally long", place="yarns.draft")
    matrix = np.asarray([[_bit(mark) for mark in row] for row in draft])
    if not np.isin(matrix, (0, 1)).all():
        what = "a draft holds 0 or '.' (weft on top) and 1 or 'x' (warp on top) only"
        raise InputError(what, place="yarns.draft")
    return matrix.astype(bool)


def _bit(mark: str | int) -> int:
    return {"x": 1, "X": 1, ".": 0}.get(mark, -1) if isinstance(mark, str) else int(mark)


def refuse_loose_yarns(pattern: np.ndarray) -> None:
    """Refuse drafts in which a yarn stays on one face: nothing would hold it."""
    for axis, name, unit in ((0, "warp", "column"), (1, "weft", "row")):
        loose = np.flatnonzero((pattern == pattern.take([0], axis)).all(axis))
        if len(loose):
            what = f"the {name} of {unit} {loose[0] + 1} never changes faces, so that nothing holds it"
            raise InputError(what, place="yarns.draft")
