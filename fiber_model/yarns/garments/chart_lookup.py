"""Which triangle of a chart holds a point of the flat cloth: a uniform grid of candidate triangles."""

from __future__ import annotations

import numpy as np

EDGE_TOLERANCE = 1e-9
"""Barycentric coordinates down to minus this count as inside, so that no point falls between neighbors."""
CHUNK = 1 << 18


class ChartLookup:
    """Point location among plane triangles, shape [n, 3, 2], none of them without area."""

    def __init__(self, triangles: np.ndarray) -> None:
        self._origin = triangles[:, 0]
        edges = np.stack([triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]], axis=2)
        self._to_barycentric = np.linalg.inv(edges)
        low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
        self._low = low
        cell = np.sqrt(max(float(np.prod(high - low)), 1e-300) / (2 * len(triangles)))
        cell = max(cell, float((high - low).max()) / 4096)
        self._cell = cell
        self._shape = np.ceil((high - low) / cell).astype(np.int64) + 1
        self._fill_cells(triangles)

    def _fill_cells(self, triangles: np.ndarray) -> None:
        """List for each cell the triangles whose bounding boxes meet it."""
        first = self._cell_of(triangles.min(axis=1) - 1e-9 * self._cell)
        last = self._cell_of(triangles.max(axis=1) + 1e-9 * self._cell)
        span = last - first + 1
        count = span.prod(axis=1)
        triangle = np.repeat(np.arange(len(triangles)), count)
        step = np.arange(len(triangle)) - np.repeat(np.cumsum(count) - count, count)
        x = first[triangle, 0] + step % span[triangle, 0]
        y = first[triangle, 1] + step // span[triangle, 0]
        cell = y * self._shape[0] + x
        order = np.argsort(cell, kind="stable")
        self._candidates = triangle[order]
        self._first = np.searchsorted(cell[order], np.arange(int(self._shape.prod()) + 1))

    def _cell_of(self, points: np.ndarray) -> np.ndarray:
        cell = np.floor((points - self._low) / self._cell).astype(np.int64)
        return np.clip(cell, 0, self._shape - 1)

    def locate(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Triangle of each point, -1 where there is none, and its barycentric coordinates, shape [n, 3]."""
        triangle = np.full(len(points), -1, np.int64)
        weights = np.zeros((len(points), 3))
        for begin in range(0, len(points), CHUNK):
            part = slice(begin, begin + CHUNK)
            self._locate_some(points[part], triangle[part], weights[part])
        return triangle, weights

    def _locate_some(self, points: np.ndarray, triangle: np.ndarray, weights: np.ndarray) -> None:
        cell = self._cell_of(points) @ np.array([1, self._shape[0]])
        left, end = self._first[cell].copy(), self._first[cell + 1]
        open_points = np.flatnonzero(left < end)
        while len(open_points):
            candidate = self._candidates[left[open_points]]
            offset = points[open_points] - self._origin[candidate]
            inverse = self._to_barycentric[candidate]
            b = inverse[:, 0, 0] * offset[:, 0] + inverse[:, 0, 1] * offset[:, 1]
            c = inverse[:, 1, 0] * offset[:, 0] + inverse[:, 1, 1] * offset[:, 1]
            a = 1.0 - b - c
            inside = np.minimum(np.minimum(a, b), c) >= -EDGE_TOLERANCE
            found = open_points[inside]
            triangle[found] = candidate[inside]
            weights[found] = np.stack([a, b, c], axis=1)[inside]
            left[open_points] += 1
            open_points = open_points[~inside & (left[open_points] < end[open_points])]
