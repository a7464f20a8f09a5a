"""Uniform Catmull-Rom curves (Catmull and Rom 1974): evaluation, arc length, and its inverse.

Segment k between control points P1 and P2 with neighbors P0 and P3, u in [0, 1]:
p(u) = 1/2 [2 P1 + (P2 - P0) u + (2 P0 - 5 P1 + 4 P2 - P3) u^2 + (3 P1 - P0 - 3 P2 + P3) u^3].
Open ends get the reflected phantom points 2 P0 - P1, so the end tangent points along the last chord.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .groups import yarn_groups, yarns_of
from .yarns import YarnSet

PIECES = 8
"""Quadrature pieces per segment; with 4 Gauss points each, lengths are good to 1e-11, near cusps to 1e-7."""
CHUNK = 1 << 14
"""Samples handled at once: temporaries of 128 KiB stay in the cache."""
_GAUSS_X, _GAUSS_W = np.polynomial.legendre.leggauss(4)


def yarn_lengths(yarns: YarnSet) -> np.ndarray:
    """Arc length of each centerline [mm], float64, shape [yarn_count]."""
    groups = yarn_groups(yarns.point_counts)
    return np.concatenate([CatmullRom.through(yarns_of(yarns, group)).lengths() for group in groups])


@dataclass(frozen=True)
class CatmullRom:
    """All yarns of a set as polynomial segments, yarn after yarn."""

    coefficients: np.ndarray
    """Polynomial of each segment [mm], float64, shape [segment_count, 4 (power of u), 3]."""
    offsets: np.ndarray
    """First segment of each yarn, int64, shape [yarn_count + 1]."""

    @classmethod
    def through(cls, yarns: YarnSet) -> CatmullRom:
        """The curves through the control points of `yarns`."""
        counts = yarns.point_counts
        segment_counts = np.where(yarns.closed, counts, counts - 1)
        offsets = np.concatenate([[0], np.cumsum(segment_counts)])
        yarn = np.repeat(np.arange(yarns.yarn_count), segment_counts)
        return cls(segment_coefficients(yarns, yarn, np.arange(offsets[-1]) - offsets[yarn]), offsets)

    def position(self, segment: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Point [mm] at parameter u of each named segment, shape [n, 3]."""
        c = self.coefficients[segment]
        u = u[:, None]
        return c[:, 0] + u * (c[:, 1] + u * (c[:, 2] + u * c[:, 3]))

    def derivative(self, segment: np.ndarray, u: np.ndarray) -> np.ndarray:
        """dp/du [mm], shape [n, 3]."""
        c = self.coefficients[segment]
        u = u[:, None]
        return c[:, 1] + u * (2 * c[:, 2] + u * (3 * c[:, 3]))

    def second_derivative(self, segment: np.ndarray, u: np.ndarray) -> np.ndarray:
        """d2p/du2 [mm], shape [n, 3]."""
        c = self.coefficients[segment]
        return 2 * c[:, 2] + u[:, None] * (6 * c[:, 3])

    @cached_property
    def speed_squares(self) -> np.ndarray:
        """Coefficients of |dp/du|^2 [mm^2], a polynomial of degree 4 in u, float64, shape [5, segment_count].

        A fifth of the numbers to fetch, and of the work, that the derivative itself would cost.
        """
        a, b, c = self.coefficients[:, 1], 2 * self.coefficients[:, 2], 3 * self.coefficients[:, 3]
        return np.stack([dot(a, a), 2 * dot(a, b), dot(b, b) + 2 * dot(a, c), 2 * dot(b, c), dot(c, c)])

    def jets(self, segment: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Point [mm], dp/du and d2p/du2 at parameter u of each named segment, shape [n, 3] each."""
        c = self.coefficients[segment]
        u = u[:, None]
        c0, c1, c2, c3 = c[:, 0], c[:, 1], c[:, 2], c[:, 3]
        return (
            c0 + u * (c1 + u * (c2 + u * c3)),
            c1 + u * (2 * c2 + u * (3 * c3)),
            2 * c2 + u * (6 * c3),
        )

    def arc_length(self, segment: np.ndarray, u0: np.ndarray, u1: np.ndarray) -> np.ndarray:
        """Length [mm] from u0 to u1 within each named segment, by 4-point Gauss-Legendre."""
        return _arc_length(self.speed_squares[:, segment], u0, u1)

    def piece_lengths(self) -> np.ndarray:
        """Length [mm] of the `PIECES` equal parameter pieces of every segment, shape [segments, PIECES]."""
        count = len(self.coefficients)
        lengths = np.empty((count, PIECES))
        for begin in range(0, count, CHUNK):
            squares = self.speed_squares[:, begin : begin + CHUNK]
            for piece in range(PIECES):
                u0 = piece / PIECES
                lengths[begin : begin + CHUNK, piece] = _arc_length(squares, u0, u0 + 1 / PIECES)
        return lengths

    def lengths(self) -> np.ndarray:
        """Arc length of each yarn [mm], shape [yarn_count]."""
        return self.knots()[self.knot_offsets[1:] - 1]

    @property
    def knot_offsets(self) -> np.ndarray:
        """First knot of each yarn, int64, shape [yarn_count + 1]: a yarn has one knot more than pieces."""
        return self.offsets * PIECES + np.arange(len(self.offsets))

    def knots(self) -> np.ndarray:
        """Arc length [mm] from the yarn's beginning to each piece's, and to the end; yarn after yarn."""
        pieces = self.piece_lengths().reshape(-1)
        first_knot, first_piece = self.knot_offsets, self.offsets * PIECES
        knots = np.zeros(first_knot[-1])
        for yarn in range(len(self.offsets) - 1):
            lengths = pieces[first_piece[yarn] : first_piece[yarn + 1]]
            np.cumsum(lengths, out=knots[first_knot[yarn] + 1 : first_knot[yarn + 1]])
        return knots

    def parameter_at(self, piece: np.ndarray, length: np.ndarray, target: np.ndarray) -> np.ndarray:
        """Parameter u in the segment of each named quadrature piece, `target` [mm] after its beginning.

        `length` [mm] is that of the whole piece. Newton on the arc length, safeguarded by bisection.
        """
        squares, start = self.speed_squares[:, piece // PIECES], (piece % PIECES) / PIECES
        low, high = start, start + 1 / PIECES
        u = start + _divide(target, length) / PIECES
        for _ in range(3):
            error = _arc_length(squares, start, u) - target
            low, high = np.where(error < 0, u, low), np.where(error < 0, high, u)
            step = u - _divide(error, _speed(squares, u))
            u = np.where((step >= low) & (step <= high), step, 0.5 * (low + high))
        return u


def segment_coefficients(yarns: YarnSet, yarn: np.ndarray, local: np.ndarray) -> np.ndarray:
    """Polynomials [mm] of segments, given by yarn and number within it, float64, shape [n, 4, 3]."""
    first, count, closed = yarns.offsets[yarn], yarns.point_counts[yarn], yarns.closed[yarn]

    def neighbor(step: int) -> np.ndarray:
        wrapped = (local + step) % count
        return yarns.points[first + np.where(closed, wrapped, np.clip(local + step, 0, count - 1))]

    p0, p1, p2, p3 = (neighbor(step) for step in (-1, 0, 1, 2))
    at_start = ~closed & (local == 0)
    at_end = ~closed & (local == count - 2)
    p0[at_start] = 2 * p1[at_start] - p2[at_start]
    p3[at_end] = 2 * p2[at_end] - p1[at_end]
    return np.stack(
        [p1, 0.5 * (p2 - p0), p0 - 2.5 * p1 + 2 * p2 - 0.5 * p3, 0.5 * (3 * p1 - p0 - 3 * p2 + p3)], axis=1
    )


def _speed(squares: np.ndarray, u: np.ndarray | float) -> np.ndarray:
    """|dp/du| [mm], from coefficients of its square, shape [5, n]."""
    a, b, c, d, e = squares
    return np.sqrt(np.maximum((((e * u + d) * u + c) * u + b) * u + a, 0.0))


def _arc_length(squares: np.ndarray, u0: np.ndarray | float, u1: np.ndarray | float) -> np.ndarray:
    """Length [mm] from u0 to u1, by 4-point Gauss-Legendre."""
    half, middle = 0.5 * (u1 - u0), 0.5 * (u1 + u0)
    total = np.zeros(squares.shape[1])
    for x, weight in zip(_GAUSS_X, _GAUSS_W, strict=True):
        total += weight * _speed(squares, middle + half * x)
    return half * total


def _divide(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a / b, and 0 where b is 0."""
    return np.divide(a, b, out=np.zeros_like(a), where=b > 0)


def norm(vectors: np.ndarray) -> np.ndarray:
    """Length of each row, shape [n]."""
    return np.sqrt(dot(vectors, vectors))


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Row-wise dot product, shape [n]; summed in a fixed order, so equal bits whatever the batch."""
    return a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2]


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Row-wise cross product, shape [n, 3]; several times as fast as numpy's for rows of three."""
    result = np.empty_like(a)
    result[:, 0] = a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1]
    result[:, 1] = a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]
    result[:, 2] = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return result
