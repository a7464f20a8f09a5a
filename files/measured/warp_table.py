"""Densities over the unit square, bilinear between the points of a grid, and the warp that follows them.

The warp of Dupuy and Jakob 2018, as powitacq's Marginal2D: rows by their marginal, then columns. `warp`
takes a uniform point to one distributed by the density, `unwarp` goes back. float64 throughout.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
EDGE = 2.0**-24
"""Uniform points keep this distance from the border, as in powitacq."""


@dataclass(frozen=True)
class Corners:
    """Slices of a table around given parameters, and their weights; each of shape [N, 4]."""

    slices: NDArray[np.intp]
    weights: Array

    def mix(self, table: Array, *index: NDArray[np.intp]) -> Array:
        """`table`, shape [slices, …], at each query's index, interpolated between the slices."""
        found = table[(self.slices, *(part[:, None] for part in index))]
        weights = self.weights.reshape(self.weights.shape + (1,) * (found.ndim - 2))
        return (found * weights).sum(axis=1)


def corners(nodes: tuple[Array, Array], at: tuple[Array, Array]) -> Corners:
    """Of two parameters, the first slower in the table; beyond their ends the last slice holds."""
    low, weight = zip(*(_bracket(n, x) for n, x in zip(nodes, at, strict=True)), strict=True)
    slices, weights = [], []
    for first in (0, 1):
        for second in (0, 1):
            index = [np.minimum(low[k] + step, len(nodes[k]) - 1) for k, step in enumerate((first, second))]
            slices.append(index[0] * len(nodes[1]) + index[1])
            parts = [weight[k] if step else 1.0 - weight[k] for k, step in enumerate((first, second))]
            weights.append(parts[0] * parts[1])
    return Corners(np.stack(slices, axis=1), np.stack(weights, axis=1))


def _bracket(nodes: Array, at: Array) -> tuple[NDArray[np.intp], Array]:
    """Index of the node below, and the weight of the one above."""
    if len(nodes) == 1:
        return np.zeros(len(at), dtype=np.intp), np.zeros(len(at))
    low = np.clip(np.searchsorted(nodes, at, side="right") - 1, 0, len(nodes) - 2)
    return low, np.clip((at - nodes[low]) / (nodes[low + 1] - nodes[low]), 0.0, 1.0)


def cell(x: Array, count: int) -> tuple[NDArray[np.intp], Array]:
    """Index of the grid's cell and the place within it, of x in [0, 1] among `count` points."""
    low = np.clip((x * (count - 1)).astype(np.intp), 0, count - 2)
    return low, x * (count - 1) - low


def bilinear(grid: Array, x: Array, y: Array) -> Array:
    """Value of a grid, shape [rows, columns], at points of the unit square; x runs along columns."""
    (column, fx), (row, fy) = cell(x, grid.shape[1]), cell(y, grid.shape[0])
    low = (1 - fx) * grid[row, column] + fx * grid[row, column + 1]
    high = (1 - fx) * grid[row + 1, column] + fx * grid[row + 1, column + 1]
    return (1 - fy) * low + fy * high


@dataclass(frozen=True)
class WarpTable:
    """Densities of all slices, each integrating to 1 over its grid's cells counted as unit squares."""

    density: Array
    """Shape [slices, rows, columns]."""
    along: Array
    """Integral from the left border to each point of a row, same shape."""
    marginal: Array
    """Integral of all rows below, shape [slices, rows]."""

    @classmethod
    def of(cls, table: Array) -> WarpTable:
        """From any non-negative table of shape [slices, rows, columns] that is nowhere all zero."""
        along = np.zeros_like(table)
        along[..., 1:] = np.cumsum(0.5 * (table[..., :-1] + table[..., 1:]), axis=-1)
        marginal = np.zeros(table.shape[:2])
        marginal[:, 1:] = np.cumsum(0.5 * (along[:, :-1, -1] + along[:, 1:, -1]), axis=-1)
        total = marginal[:, -1:]
        return cls(table / total[..., None], along / total[..., None], marginal / total)

    def unwarp(self, x: Array, y: Array, at: Corners) -> tuple[Array, Array]:
        """The uniform points that the warp takes to (x, y), by slices mixed as `at` says."""
        (column, fx), (row, fy) = cell(x, self.density.shape[2]), cell(y, self.density.shape[1])
        last = np.full_like(column, self.density.shape[2] - 1)
        low, high = (
            (1 - fy) * at.mix(self.density, row, c) + fy * at.mix(self.density, row + 1, c)
            for c in (column, column + 1)
        )
        begin = (1 - fy) * at.mix(self.along, row, column) + fy * at.mix(self.along, row + 1, column)
        below, above = at.mix(self.along, row, last), at.mix(self.along, row + 1, last)
        width = (1 - fy) * below + fy * above
        u = (begin + fx * (low + 0.5 * fx * (high - low))) / np.where(width > 0, width, 1.0)
        return u, at.mix(self.marginal, row) + fy * (below + 0.5 * fy * (above - below))

    def warp_grid(self, index: int, rows: int, columns: int) -> tuple[Array, Array]:
        """Where slice `index` takes the points of a regular grid over the unit square; x and y, each
        of shape [rows, columns]."""
        density, along, marginal = self.density[index], self.along[index], self.marginal[index]
        v = np.clip(np.linspace(0, 1, rows), EDGE, 1 - EDGE)
        u = np.clip(np.linspace(0, 1, columns), EDGE, 1 - EDGE)
        row = np.clip(np.searchsorted(marginal, v, side="left") - 1, 0, len(marginal) - 2)
        fy = _ramp_inverse(v - marginal[row], along[row, -1], along[row + 1, -1])
        x, y = (
            np.empty((rows, columns)),
            np.repeat((row + fy)[:, None] / (len(marginal) - 1), columns, axis=1),
        )
        for i, (r, f) in enumerate(zip(row, fy, strict=True)):
            heights = (1 - f) * density[r] + f * density[r + 1]
            sums = (1 - f) * along[r] + f * along[r + 1]
            target = u * sums[-1]
            column = np.clip(np.searchsorted(sums, target, side="left") - 1, 0, len(sums) - 2)
            fx = _ramp_inverse(target - sums[column], heights[column], heights[column + 1])
            x[i] = (column + fx) / (len(sums) - 1)
        return x, y


def _ramp_inverse(area: Array, begin: Array, end: Array) -> Array:
    """t with integral of begin + s (end - begin) over s in [0, t] equal to the area."""
    root = begin + np.sqrt(np.maximum(begin**2 - 2.0 * area * (begin - end), 0.0))
    return np.clip(2.0 * area / np.where(root > 0, root, 1.0), 0.0, 1.0)
