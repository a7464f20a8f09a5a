"""Seams: ends of yarn that meet across the border of charts, in line, become one yarn again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from weft.fiber_model.yarns.catmull_rom import dot, norm

if TYPE_CHECKING:
    from .on_mesh import Laid

IN_LINE = 0.7
"""Least cosine between one end's direction and the continuation by the other."""


@dataclass(frozen=True)
class Joined:
    """Whole yarns, in the order of their first pieces."""

    curves: list[np.ndarray]
    """Control points [mm] of each, shape [n, 3]."""
    uv: list[np.ndarray]
    """Surface coordinates of each, shape [n, 2]."""
    closed: list[bool]
    """Whether each is a loop."""
    first_piece: np.ndarray
    """A piece that each is made of, int64, shape [yarn_count]."""
    joint_count: int
    open_end_count: int
    """Ends that were cut at a border and meet nothing there."""


def join_pieces(laid: Laid, *, reach: float) -> Joined:
    """Join ends no farther apart than `reach` yarn radii; 0 joins nothing."""
    partner = _partners(laid, reach) if reach > 0 else np.full(2 * len(laid.closed), -1, np.int64)
    curves, uv, closed, first_piece = [], [], [], []
    unseen = np.ones(len(laid.closed), bool)
    loose = np.flatnonzero((partner.reshape(-1, 2) < 0).any(axis=1))
    for piece in [*loose, *range(len(unseen))]:
        if unseen[piece]:
            side = 0 if partner[2 * piece] < 0 else 1 if partner[2 * piece + 1] < 0 else 0
            chain, loop = _follow(2 * int(piece) + side, partner, unseen)
            curves.append(_chained(laid.points, laid.offsets, chain, loop, average=True))
            uv.append(_chained(laid.uv, laid.offsets, chain, loop, average=False))
            closed.append(loop or bool(laid.closed[piece]))
            first_piece.append(piece)
    return Joined(
        curves,
        uv,
        closed,
        np.array(first_piece, dtype=np.int64),
        joint_count=int((partner >= 0).sum()) // 2,
        open_end_count=int((laid.is_cut.reshape(-1) & (partner < 0)).sum()),
    )


def _partners(laid: Laid, reach: float) -> np.ndarray:
    """The end that each end continues in, int64, shape [2 piece_count]; end 2 p + 1 is the last of piece p.

    Two ends pair where each is the other's nearest, they lead on in line, and their yarns are alike.
    """
    from scipy.spatial import cKDTree

    partner = np.full(2 * len(laid.closed), -1, np.int64)
    end = np.flatnonzero(laid.is_cut.reshape(-1))
    if len(end) < 2:
        return partner
    place, outward = _ends(laid, end)
    distance, nearest = (value[:, 1] for value in cKDTree(place).query(place, k=2))
    # with equal places either row may come first
    own = nearest == np.arange(len(end))
    nearest = np.where(own, cKDTree(place).query(place, k=2)[1][:, 0], nearest)
    piece, other = end // 2, end[nearest] // 2
    good = (
        (nearest[nearest] == np.arange(len(end)))
        & (nearest != np.arange(len(end)))
        & (distance <= reach * np.minimum(laid.radius[piece], laid.radius[other]))
        & (dot(outward, -outward[nearest]) >= IN_LINE)
        & (laid.yarn_type[piece] == laid.yarn_type[other])
        & (laid.radius[piece] == laid.radius[other])
    )
    partner[end[good]] = end[nearest[good]]
    return partner


def _ends(laid: Laid, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Place [mm] of the named ends and the unit direction in which the yarn would go on."""
    piece, is_last = end // 2, end % 2 == 1
    index = np.where(is_last, laid.offsets[piece + 1] - 1, laid.offsets[piece])
    place = laid.points[index]
    outward = place - laid.points[np.where(is_last, index - 1, index + 1)]
    return place, outward / np.maximum(norm(outward), 1e-300)[:, None]


def _follow(start: int, partner: np.ndarray, unseen: np.ndarray) -> tuple[list[int], bool]:
    """Ends at which the pieces of a chain are entered, beginning with `start`, and whether it is a loop."""
    chain, at = [], start
    while True:
        unseen[at // 2] = False
        chain.append(at)
        at = int(partner[at ^ 1])
        if at < 0 or not unseen[at // 2]:
            return chain, at == start


def _chained(
    values: np.ndarray, offsets: np.ndarray, chain: list[int], loop: bool, *, average: bool
) -> np.ndarray:
    """Values along a chain; at each joint one point stands for the two that meet there."""
    parts = []
    for at in chain:
        part = values[offsets[at // 2] : offsets[at // 2 + 1]]
        parts.append(part[::-1] if at % 2 else part)
    if len(parts) == 1 and not loop:
        return parts[0]
    joined = []
    for k, part in enumerate(parts):
        before = parts[k - 1] if k or loop else None
        start = part[:1] if before is None or not average else 0.5 * (part[:1] + before[-1:])
        is_last = k == len(parts) - 1 and not loop
        joined += [start, part[1:] if is_last else part[1:-1]]
    return np.concatenate(joined)
