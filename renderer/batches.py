"""RenderBatches: parts of the screen whose bricks fit the device's pool (the thesis, section 5.6.1).

The screen is halved, the part that needs most memory first, until the bricks in every part's frustum fit.
Here batches only decide in which order pixels are traced and what is loaded beforehand; they change no bit
of the picture.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from weft.voxelize.grid import BRICK_SIZE

from .brick_pool import EMPTY_CELL, LEVEL_SHIFT

SMALLEST_SIDE = 8
"""Pixels below which no side is halved."""
SMALLEST_HEIGHT = 2
"""Of a strip [pixels]."""
STRIP_SHARE = 0.15
"""Of the pool, for what a strip sees; the strips before it stay as long as they have room."""
RIM_ACROSS, RIM_ALONG = 3 / 16, 1 / 8
"""Of a swath's width: how far into the swath before, and beyond its own rows, bricks are loaded along with a
strip where paths wait for them."""
ROUNDING = 1e-3
"""Of the device's camera rays, at most [pixels]."""
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
    """Pixels that may see each cell, by its corners and `margin` pixels more.

    `sides`: cells along the edge of each, where they are not all single.

    `camera`: the kernel's uniforms `camera_*`, `lens` and `image_size`, in voxels.
    """
    count = len(places)
    low, high = np.empty((count, 2), np.int32), np.empty((count, 2), np.int32)
    depth = np.empty(count, np.float32)
    for start in range(0, count, CELLS_PER_CHUNK):
        part = slice(start, start + CELLS_PER_CHUNK)
        side = np.ones(len(places[part])) if sides is None else sides[part]
        corner = places[part] * float(BRICK_SIZE)
        low[part], high[part], depth[part] = _project(corner, BRICK_SIZE * side, camera, margin)
    return Footprints(low, high, depth)


def _project(
    corner: np.ndarray, edge: np.ndarray, camera: Mapping[str, Any], margin: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of cubes with these lower corners and edges: what their eight corners span, exact for a pinhole."""
    size = np.array(camera["image_size"], float)
    axes = np.stack([camera["camera_right"], camera["camera_up"]], axis=-1)
    reach = np.linalg.norm(axes, axis=0)
    low, high = np.full((len(corner), 2), np.inf), np.full((len(corner), 2), -np.inf)
    near, far = np.full(len(corner), np.inf), np.full(len(corner), -np.inf)
    for step in itertools.product((0.0, 1.0), repeat=3):
        offset = corner + edge[:, None] * np.array(step) - np.array(camera["camera_position"])
        depth = offset @ np.array(camera["camera_forward"])
        across = offset @ (axes / reach)
        if camera["camera_perspective"]:
            across /= np.maximum(depth, 1e-6)[:, None]
        low, high = np.minimum(low, across), np.maximum(high, across)
        near, far = np.minimum(near, depth), np.maximum(far, depth)
    if camera["camera_perspective"]:
        around = (near <= 0) & (far > 0)
        low[around], high[around] = -np.inf, np.inf
        blur = _blur(camera["lens"], np.maximum(near, 1e-6), np.maximum(far, 1e-6))[:, None]
        low, high = low - blur, high + blur
    low, high = low / reach, high / reach
    # rows count downward
    low[:, 1], high[:, 1] = -high[:, 1], -low[:, 1].copy()
    pixels = [np.clip((s + 1) / 2 * size, -1e6, 1e6) for s in (low, high)]
    first, last = np.floor(pixels[0] - margin - ROUNDING), np.floor(pixels[1] + margin + ROUNDING)
    behind = bool(camera["camera_perspective"]) & (far <= 0)
    last = np.where(behind[:, None], first - 1, last)
    return first.astype(np.int32), last.astype(np.int32), ((near + far) / 2).astype(np.float32)


def _blur(lens: tuple[float, ...], near: np.ndarray, far: np.ndarray) -> np.ndarray:
    """How far a thin lens moves a point at these depths, at most, at distance 1."""
    radius, focus = lens[0], lens[1]
    if radius == 0:
        return np.zeros(len(near))
    return radius * np.maximum(np.abs(1 / near - 1 / focus), np.abs(1 / far - 1 / focus))


def subdivide_screen(
    columns: range,
    rows: range,
    footprints: Footprints,
    layers: np.ndarray,
    capacity: int,
    *,
    strips: bool = False,
) -> list[RenderBatch]:
    """Batches whose cells hold at most `capacity` bricks, or that are too small to be halved.

    A priority queue hands out the part that needs most memory, as the thesis has it; neighbors follow
    each other in the result. `strips`: only rows are halved.
    """
    all_cells = seen_cells(columns, rows, footprints)
    queue: list[tuple[int, tuple[int, ...], range, range, np.ndarray]] = [
        (-int(layers[all_cells].sum()), (), columns, rows, all_cells)
    ]
    done: list[tuple[tuple[int, ...], RenderBatch]] = []
    while queue:
        demand, path, columns, rows, cells = heapq.heappop(queue)
        small = len(rows) <= SMALLEST_HEIGHT if strips else max(len(columns), len(rows)) <= SMALLEST_SIDE
        if -demand <= capacity or small:
            nearest = cells[np.argsort(footprints.depth[cells], kind="stable")]
            done.append((path, RenderBatch(columns, rows, nearest)))
            continue
        for half, (part_columns, part_rows) in enumerate(_halves(columns, rows, strips)):
            part = _seen(footprints, cells, part_columns, part_rows)
            size = int(layers[part].sum())
            heapq.heappush(queue, (-size, (*path, half), part_columns, part_rows, part))
    return [batch for _, batch in sorted(done, key=lambda item: item[0])]


def screen_strips(
    columns: range, rows: range, footprints: Footprints, layers: np.ndarray, capacity: int, swaths: int
) -> list[RenderBatch]:
    """Batches in the order that keeps most bricks in a pool: strips of swaths, down one and up the next."""
    found = []
    for swath in range(swaths):
        part = range(*(columns.start + len(columns) * (swath + i) // swaths for i in (0, 1)))
        limit = int(capacity * STRIP_SHARE)
        strips = subdivide_screen(part, rows, footprints, layers, limit, strips=True)
        found += strips[::-1] if swath % 2 else strips
    return found


def rim_of(strip: RenderBatch, wanted: np.ndarray, footprints: Footprints) -> np.ndarray:
    """Those of the cells `wanted` that lie around a strip, or in the swath before beside it."""
    across, along = (math.ceil(share * len(strip.columns)) for share in (RIM_ACROSS, RIM_ALONG))
    columns = range(strip.columns.start - across, strip.columns.stop)
    rows = range(strip.rows.start - along, strip.rows.stop + along)
    return np.setdiff1d(_seen(footprints, wanted, columns, rows), strip.cells)


def _halves(columns: range, rows: range, strips: bool) -> list[tuple[range, range]]:
    if len(columns) >= len(rows) and not strips:
        middle = len(columns) // 2
        return [(columns[:middle], rows), (columns[middle:], rows)]
    middle = len(rows) // 2
    return [(columns, rows[:middle]), (columns, rows[middle:])]


def seen_cells(columns: range, rows: range, footprints: Footprints) -> np.ndarray:
    """Cells that some pixel of a rectangle may see."""
    return _seen(footprints, np.arange(len(footprints.low)), columns, rows)


def _seen(footprints: Footprints, cells: np.ndarray, columns: range, rows: range) -> np.ndarray:
    """Those of `cells` that some pixel of the rectangle may see."""
    low, high = footprints.low[cells], footprints.high[cells]
    first, last = np.array([columns.start, rows.start]), np.array([columns.stop, rows.stop]) - 1
    return cells[((low <= last) & (high >= first)).all(axis=1)]
