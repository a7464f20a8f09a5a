"""Periodic yarn tiles: chains of vertices that leave the tile on one side and come back on the other.

Every chain is followed through the whole tiling, so its yarn runs unbroken across tile borders.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from weft.fiber_model.yarns.material_frame import edge_directors_at_points, material_twist
from weft.fiber_model.yarns.yarns import YarnSet, refuse_too_many_points
from weft.files.errors import InputError

from .cut import cut_to_rectangle


@dataclass(frozen=True)
class PeriodicTile:
    """One period of a fabric in the x, y plane, z out of the fabric. Everything is stored per vertex.

    The edge that leaves vertex v goes to `next_vertex[v]` in the tile `next_step[v]` away.
    """

    period: np.ndarray
    """Extent of the tile [mm], float64, shape [2]."""
    radius: float
    """Yarn radius [mm]."""
    points: np.ndarray
    """Vertices [mm], float64, shape [vertex_count, 3]."""
    next_vertex: np.ndarray
    """Vertex that follows, int64, shape [vertex_count]; -1 where the yarn ends."""
    next_step: np.ndarray
    """Tiles to go along x and y to the vertex that follows, int64, shape [vertex_count, 2]."""
    director: np.ndarray | None = None
    """Reference director of the edge that leaves each vertex, float64, shape [vertex_count, 3]."""
    twist: np.ndarray | None = None
    """Angle [rad] of the material against the reference director on that edge, shape [vertex_count]."""
    rest_length: np.ndarray | None = None
    """Unstretched length of that edge [mm], shape [vertex_count]."""

    def edge_vectors(self) -> np.ndarray:
        """Vector [mm] from each vertex to the next, shape [vertex_count, 3]; zero where the yarn ends."""
        edge = self.points[self.next_vertex] - self.points
        edge[:, :2] += self.next_step * self.period
        return np.where(self.next_vertex[:, None] >= 0, edge, 0.0)


@dataclass(frozen=True)
class Chain:
    """One yarn of a tile, over one period."""

    vertices: np.ndarray
    """Vertices in order, int64, shape [n]."""
    steps: np.ndarray
    """Tile in which each lies, counted from the first vertex's tile, int64, shape [n, 2]."""
    translation: tuple[int, int]
    """Tile in which the chain meets its first vertex again; (0, 0) for a loop."""
    open: bool
    """Whether the chain ends within the tile instead of meeting its first vertex again."""


def tile_yarns(
    tile: PeriodicTile,
    size_mm: tuple[float, float],
    *,
    type_name: str = "yarn",
    source: Path | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> YarnSet:
    """Cover the rectangle `size_mm` around the origin with the tile, and cut the yarns at its border."""
    repeats = tuple(
        int(np.ceil(size / period)) + 2 for size, period in zip(size_mm, tile.period, strict=True)
    )
    refuse_too_many_points(len(tile.points) * repeats[0] * repeats[1], "yarns.size_mm: the tiled rectangle")
    yarns, translation = repeat_tile(tile, (repeats[0], repeats[1]), type_name=type_name)
    if progress is not None:
        progress(0.5, f"{repeats[0]} x {repeats[1]} tiles")
    cut = cut_to_rectangle(yarns, size_mm, cut_axes=cut_axes_of(translation))
    if cut is None:
        size, period = (f"{a:g} x {b:g}" for a, b in (size_mm, tile.period))
        raise InputError(
            f"no yarn of this tile of {period} mm fits into {size} mm; raise size_mm", path=source
        )
    return cut


def repeat_tile(
    tile: PeriodicTile, repeats: tuple[int, int], *, type_name: str = "yarn"
) -> tuple[YarnSet, np.ndarray]:
    """The yarns of `repeats` tiles along x and y, centered at the origin, and each yarn's period in tiles.

    A yarn that continues into the next tile ends with the vertex it would continue from, so the yarns cover
    their full periods. Twist is carried where the tile has material directors.
    """
    index: list[np.ndarray] = []
    shift: list[np.ndarray] = []
    closed: list[bool] = []
    translation: list[tuple[int, int]] = []
    for chain in follow_chains(tile):
        is_loop = not chain.open and chain.translation == (0, 0)
        for base, periods in _chain_bases(chain, repeats):
            vertices, steps = _unroll(chain, periods)
            index.append(vertices)
            shift.append(steps + base)
            closed.append(is_loop)
            translation.append(chain.translation)
    curves = [
        tile.points[vertices] + np.pad(steps * tile.period, ((0, 0), (0, 1)))
        for vertices, steps in zip(index, shift, strict=True)
    ]
    low, high = (end([end(curve[:, :2], axis=0) for curve in curves], axis=0) for end in (np.min, np.max))
    curves = [curve - np.append(0.5 * (low + high), 0.0) for curve in curves]
    yarns = YarnSet.checked(curves, closed=closed, radius=tile.radius, type_names=(type_name,))
    return _with_twist(tile, yarns, np.concatenate(index)), np.array(translation)


def cut_axes_of(translation: np.ndarray) -> np.ndarray:
    """Along which axes yarns of these periods are cut, bool, shape [yarn_count, 2].

    A yarn that runs along one axis is cut across it and otherwise kept or dropped whole: a knit is not slit
    through its loops, which would leave loose arcs at the edge. Loops are kept or dropped whole.
    """
    return translation != 0


def follow_chains(tile: PeriodicTile) -> list[Chain]:
    """The yarns of one tile; each vertex belongs to exactly one."""
    unseen = np.ones(len(tile.points), bool)
    has_previous = np.zeros(len(tile.points), bool)
    has_previous[tile.next_vertex[tile.next_vertex >= 0]] = True
    starts = [*np.flatnonzero(~has_previous), *np.flatnonzero(has_previous)]
    return [_follow(tile, int(first), unseen) for first in starts if unseen[first]]


def _follow(tile: PeriodicTile, first: int, unseen: np.ndarray) -> Chain:
    """The chain from `first` until it ends or meets `first` again; marks its vertices as seen."""
    vertices, steps, at = [], [], (0, 0)
    vertex = first
    while vertex >= 0 and unseen[vertex]:
        unseen[vertex] = False
        vertices.append(vertex)
        steps.append(at)
        at = (at[0] + int(tile.next_step[vertex, 0]), at[1] + int(tile.next_step[vertex, 1]))
        vertex = int(tile.next_vertex[vertex])
    return Chain(np.array(vertices), np.array(steps), (0, 0) if vertex < 0 else at, vertex < 0)


def _chain_bases(chain: Chain, repeats: tuple[int, int]) -> list[tuple[np.ndarray, int]]:
    """First tile of each yarn that a chain makes in the tiling, and over how many periods it runs.

    Every tile holds the chain's first vertex once; tiles one translation apart share a yarn.
    """
    tiles = [(i, j) for i in range(repeats[0]) for j in range(repeats[1])]
    (a, b) = chain.translation
    if (a, b) == (0, 0):
        return [(np.array(tile), 1) for tile in tiles]

    def inside(i: int, j: int) -> bool:
        return 0 <= i < repeats[0] and 0 <= j < repeats[1]

    bases = []
    for i, j in tiles:
        if not inside(i - a, j - b):
            periods = 1
            while inside(i + periods * a, j + periods * b):
                periods += 1
            bases.append((np.array([i, j]), periods))
    return bases


def _unroll(chain: Chain, periods: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and tile steps of a chain over several periods, with the vertex that follows the last."""
    vertices = np.tile(chain.vertices, periods)
    step = np.array(chain.translation)
    steps = np.concatenate([chain.steps + period * step for period in range(periods)])
    if chain.translation != (0, 0):
        vertices = np.append(vertices, chain.vertices[0])
        steps = np.concatenate([steps, [periods * step]])
    return vertices, steps


def _with_twist(tile: PeriodicTile, yarns: YarnSet, vertex: np.ndarray) -> YarnSet:
    """Add the material twist where the tile knows its directors."""
    if tile.director is None or tile.twist is None:
        return yarns
    previous = np.arange(len(tile.points))
    linked = tile.next_vertex >= 0
    previous[tile.next_vertex[linked]] = np.flatnonzero(linked)
    director = edge_directors_at_points(tile.director, tile.edge_vectors(), tile.twist, previous)
    fields = {name: getattr(yarns, name) for name in yarns.__dataclass_fields__}
    return YarnSet(**(fields | {"twist": material_twist(yarns, director[vertex])}))
