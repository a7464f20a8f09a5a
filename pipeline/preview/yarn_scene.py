"""Yarns as tubes of their radius along their Catmull-Rom curves, colored by yarn type."""

from __future__ import annotations

import numpy as np

from weft.fiber_model.yarns.catmull_rom import CatmullRom, yarn_lengths
from weft.fiber_model.yarns.fabrics.tile import PeriodicTile, repeat_tile
from weft.fiber_model.yarns.yarns import YarnSet

from . import part
from .scene import Scene, Tubes, count_text, length_text, palette_color, size_text

STEPS = 8
"""Pieces of tube per segment of the curve."""
MANY_POINTS = 200_000
"""From here on tubes have 8 sides in place of 20."""
TILE_REPEATS = (2, 2)


def yarn_scene(name: str, yarns: YarnSet, *, box: np.ndarray | None = None) -> Scene:
    """All yarns, or the part of them within `box`."""
    points, offsets = sampled_curves(yarns, _steps(yarns))
    index, kept_offsets, notes = part.chosen_part(points, offsets, box, what="yarns")
    yarn = np.searchsorted(offsets, index, side="right") - 1
    colors = np.array([palette_color(i) for i in range(len(yarns.type_names))], np.uint8)
    tubes = Tubes(
        points=points[index],
        offsets=kept_offsets,
        radius=yarns.radius[yarn[kept_offsets[:-1]]].astype(np.float32),
        color=colors[yarns.yarn_type[yarn]],
        sides=20 if len(index) < MANY_POINTS else 8,
    )
    margin = tubes.radius.max()
    return Scene(
        kind="yarns",
        title=f"{name}: {_summary(yarns)}",
        layers=(tubes,),
        bounds=part.bounds_of(tubes.points) + np.array([[-margin], [margin]]),
        notes=notes,
        legend=tuple((_type_text(yarns, i), palette_color(i)) for i in range(len(yarns.type_names))),
    )


def tile_scene(name: str, tile: PeriodicTile, *, box: np.ndarray | None = None) -> Scene:
    """A periodic tile, repeated a few times so that its yarns meet, with one period outlined."""
    yarns, _ = repeat_tile(tile, TILE_REPEATS)
    scene = yarn_scene(name, yarns, box=box)
    middle = 0.5 * (tile.points.min(axis=0) + tile.points.max(axis=0))
    half = 0.5 * np.array([*tile.period, np.ptp(tile.points[:, 2]) + 2.4 * tile.radius])
    period = " x ".join(f"{extent:.3g}" for extent in tile.period)
    length = float(np.linalg.norm(tile.edge_vectors(), axis=1).sum())
    center = np.array([0.0, 0.0, middle[2]])
    return Scene(
        kind=scene.kind,
        title=f"{name}: periodic tile of {period} mm with {length_text(length)} of yarn",
        layers=scene.layers,
        bounds=scene.bounds,
        notes=(*scene.notes, f"{TILE_REPEATS[0]} x {TILE_REPEATS[1]} tiles are shown; the box is one period"),
        legend=scene.legend,
        frame=np.stack([center - half, center + half]),
    )


def sampled_curves(yarns: YarnSet, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Points [mm] along the curves, float32, and offsets.

    A loop goes on over its beginning by one piece, so that its tube has no gap and no seam.
    """
    curve = CatmullRom.through(yarns)
    pieces = np.diff(curve.offsets) * steps
    counts = pieces + np.where(yarns.closed, 2, 1)
    offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    yarn = np.repeat(np.arange(yarns.yarn_count), counts)
    place = (np.arange(offsets[-1]) - offsets[yarn]) % np.where(yarns.closed, pieces, pieces + 1)[yarn]
    local = np.minimum(place // steps, pieces[yarn] // steps - 1)
    points = curve.position(curve.offsets[yarn] + local, (place - local * steps) / steps)
    return points.astype(np.float32), offsets


def _steps(yarns: YarnSet) -> int:
    """Fewer pieces per segment where there are very many segments."""
    return int(np.clip(4 * part.TUBE_POINTS // max(yarns.point_count, 1), 1, STEPS))


def _summary(yarns: YarnSet) -> str:
    loops = int(yarns.closed.sum())
    closed = f" ({loops:,} closed)" if loops else ""
    length = length_text(float(yarn_lengths(yarns).sum()))
    return f"{count_text(yarns.yarn_count, 'yarn')}{closed}, {length}, {size_text(yarns.bounds)}"


def _type_text(yarns: YarnSet, index: int) -> str:
    radius = yarns.radius[yarns.yarn_type == index]
    if not radius.size:
        return f"{yarns.type_names[index]} (none)"
    low, high = radius.min(), radius.max()
    return f"{yarns.type_names[index]}, radius {low:.3g}{f' to {high:.3g}' if high > low else ''} mm"
