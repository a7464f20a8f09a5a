"""RenderBatches: parts of the screen whose bricks fit the device's pool (the thesis, section 5.6.1).

The screen is halved, the part that needs most memory first, until the bricks in every part's frustum fit.
Here batches only decide in which order pixels are traced and what is loaded beforehand; they change no bit
of the picture.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from .brick_pool import EMPTY_CELL, LEVEL_SHIFT

SMALLEST_SIDE = 8
"""Pixels below which no side is halved."""
CELL_RADIUS = 4 * math.sqrt(3)
"""Of the ball around a cell [voxels]."""
CELLS_PER_CHUNK = 1 << 18


@dataclass(frozen=True)
class OccupiedCells:
    """The cells that hold bricks, in the order of their bricks."""

    places: np.ndarray
    """Cell coordinates, int32, shape [cell_count, 3]."""
    first: np.ndarray
    """First brick, int64, shape [cell_count]."""
    layers: np.ndarray
    """Number of bricks, int64, shape [cell_count]."""
    sides: np.ndarray
    """Cells along its edge, int64, shape [cell_count]: one but for bricks of coarser levels."""


@dataclass(frozen=True)
class Footprints:
    """Where cells appear on the screen, never too small."""

    low: np.ndarray
    """First pixel that may see the cell, int32, shape [cell_count, 2]: column, row."""
    high: np.ndarray
    """Last such pixel; less than `low` for cells behind the camera."""
    depth: np.ndarray
    """Along the view, float32, shape [cell_count] [voxels]."""


@dataclass(frozen=True)
class RenderBatch:
    """A rectangle of pixels and the cells in its frustum, nearest first."""

    columns: range
    rows: range
    cells: np.ndarray


def occupied_cells(cells: np.ndarray, *, leveled: bool = False) -> OccupiedCells:
    """From the words of all cells (brick_pool.py). `leveled`: of levels; what shares bricks is one."""
    flat = np.flatnonzero(cells.reshape(-1) < EMPTY_CELL)
    words = cells.reshape(-1)[flat]
    places = np.stack(np.unravel_index(flat, cells.shape), axis=-1).astype(np.int32)
    layers = (words >> 28).astype(np.int64) + 1
    if not leveled:
        return OccupiedCells(places, (words & 0x0FFFFFFF).astype(np.int64), layers, np.ones_like(layers))
    first, cell = np.unique(words & (1 << LEVEL_SHIFT) - 1, return_index=True)
    level = (words[cell] >> LEVEL_SHIFT & 7).astype(np.int64)
    corners = (places[cell] >> level[:, None]) << level[:, None]
    return OccupiedCells(corners.astype(np.int32), first.astype(np.int64), layers[cell], 1 << level)


def cell_footprints(
    places: np.ndarray, camera: Mapping[str, Any], margin: float, sides: np.ndarray | None = None
) -> Footprints:
    """Pixels that may see each cell, by the ball around it and `margin` pixels more.

    `sides`: cells along the edge of each, where they are not all single.

    `camera`: the kernel's uniforms `camera_*`, `lens` and `image_size`, in voxels.
    """
    count = len(places)
    low, high = np.empty((count, 2), np.int32), np.empty((count, 2), np.int32)
    depth = np.empty(count, np.float32)
    for start in range(0, count, CELLS_PER_CHUNK):
        part = slice(start, start + CELLS_PER_CHUNK)
        side = np.ones(len(places[part])) if sides is None else sides[part]
        middle = places[part] * 8.0 + 4.0 * side[:, None]
        low[part], high[part], depth[part] = _project(middle, CELL_RADIUS * side, camera, margin)
    return Footprints(low, high, depth)


def _project(
    points: np.ndarray, radius: np.ndarray, camera: Mapping[str, Any], margin: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    size = np.array(camera["image_size"], float)
    offset = points - np.array(camera["camera_position"])
    depth = offset @ np.array(camera["camera_forward"])
    axes = np.stack([camera["camera_right"], camera["camera_up"]], axis=-1)
    reach = np.linalg.norm(axes, axis=0)
    across = offset @ (axes / reach)
    near, far = np.ones(len(points)), np.ones(len(points))
    if camera["camera_perspective"]:
        near, far = np.maximum(depth - radius, 1e-6), np.maximum(depth + radius, 1e-6)
    edges = np.stack(
        [(across + side[:, None]) / t[:, None] for side in (-radius, radius) for t in (near, far)]
    )
    blur = _blur(camera["lens"], near, far)[:, None]
    low = (edges.min(axis=0) - blur) / reach
    high = (edges.max(axis=0) + blur) / reach
    # rows count downward
    low[:, 1], high[:, 1] = -high[:, 1], -low[:, 1].copy()
    behind = camera["camera_perspective"] and depth + radius <= 0
    pixels = [np.clip((s + 1) / 2 * size, -1e6, 1e6) for s in (low, high)]
    first, last = np.floor(pixels[0] - margin), np.floor(pixels[1] + margin)
    last = np.where(np.reshape(behind, (-1, 1)), first - 1, last)
    return first.astype(np.int32), last.astype(np.int32), depth.astype(np.float32)


def _blur(lens: tuple[float, ...], near: np.ndarray, far: np.ndarray) -> np.ndarray:
    """How far a thin lens moves a point at these depths, at most, at distance 1."""
    radius, focus = lens[0], lens[1]
    if radius == 0:
        return np.zeros(len(near))
    return radius * np.maximum(np.abs(1 / near - 1 / focus), np.abs(1 / far - 1 / focus))


def subdivide_screen(
    columns: range, rows: range, footprints: Footprints, layers: np.ndarray, capacity: int
) -> list[RenderBatch]:
    """Batches whose cells hold at most `capacity` bricks, or that are too small to be halved.

    A priority queue hands out the part that needs most memory, as the thesis has it; neighbors follow
    each other in the result.
    """
    all_cells = _seen(footprints, np.arange(len(layers)), columns, rows)
    queue: list[tuple[int, tuple[int, ...], range, range, np.ndarray]] = [
        (-int(layers[all_cells].sum()), (), columns, rows, all_cells)
    ]
    done: list[tuple[tuple[int, ...], RenderBatch]] = []
    while queue:
        demand, path, columns, rows, cells = heapq.heappop(queue)
        if -demand <= capacity or max(len(columns), len(rows)) <= SMALLEST_SIDE:
            nearest = cells[np.argsort(footprints.depth[cells], kind="stable")]
            done.append((path, RenderBatch(columns, rows, nearest)))
            continue
        for half, (part_columns, part_rows) in enumerate(_halves(columns, rows)):
            part = _seen(footprints, cells, part_columns, part_rows)
            size = int(layers[part].sum())
            heapq.heappush(queue, (-size, (*path, half), part_columns, part_rows, part))
    return [batch for _, batch in sorted(done, key=lambda item: item[0])]


def _halves(columns: range, rows: range) -> list[tuple[range, range]]:
    if len(columns) >= len(rows):
        middle = len(columns) // 2
        return [(columns[:middle], rows), (columns[middle:], rows)]
    middle = len(rows) // 2
    return [(columns, rows[:middle]), (columns, rows[middle:])]


def _seen(footprints: Footprints, cells: np.ndarray, columns: range, rows: range) -> np.ndarray:
    """Those of `cells` that some pixel of the rectangle may see."""
    low, high = footprints.low[cells], footprints.high[cells]
    first, last = np.array([columns.start, rows.start]), np.array([columns.stop, rows.stop]) - 1
    return cells[((low <= last) & (high >= first)).all(axis=1)]
