"""A fiber volume: slices of density with directions on a subsample, or the surface of a density."""

from __future__ import annotations

import numpy as np

from weft.files.errors import InputError
from weft.voxelize.grid import BRICK_SIZE, FiberVolume

from . import grid_slice
from .grid_slice import Region
from .options import SlicePlane
from .part import box_text
from .scene import (
    Axes,
    Layer,
    Scene,
    Slice,
    Surface,
    View,
    count_text,
    direction_color,
    length_text,
    palette_color,
    size_text,
)

SLICE_CELLS = 4_000_000
"""Cells of one slice; larger ones are averaged over 2, 4 or 8 voxels."""
BLOCK_CELLS = 12_000_000
"""Cells in which a surface is looked for."""
GLYPHS_ALONG = 40
"""At most so many directions along the longer side of a slice."""
STRIDES = (1, 2, 4, 8)


def grid_scene(
    name: str,
    volume: FiberVolume,
    *,
    slices: tuple[SlicePlane, ...] = (),
    surface: float | None = None,
    box: np.ndarray | None = None,
) -> Scene:
    """Slices, or the surface where the density passes `surface`; by default the slice through the middle."""
    region = grid_slice.region_of(volume, box)
    if region is None:
        within = box_text(volume.bounds_mm) if volume.brick_count else "it is empty"
        raise InputError(f"{name}: nothing of the grid to show in this box; it lies within {within}")
    planes = slices or (() if surface is not None else (_middle_plane(volume, region),))
    layers: list[Layer] = []
    notes = [] if box is None else [f"part: {box_text(region.bounds_mm(volume.voxel_size_mm))}"]
    for plane in planes:
        plane_layers, plane_notes = _slice_layers(volume, region, plane)
        layers += plane_layers
        notes += plane_notes
    if surface is not None:
        layer, stride = _surface(volume, region, surface)
        layers.append(layer)
        notes.append(f"surface where the volume fraction is {surface:g}{_averaged(stride, 3)}")
    bounds = region.bounds_mm(volume.voxel_size_mm)
    legend = [(f"direction, {medium}", direction_color(i)) for i, medium in enumerate(volume.media)]
    return Scene(
        kind="grid",
        title=f"{name}: {_summary(volume)}",
        layers=tuple(layers),
        bounds=bounds,
        notes=tuple(dict.fromkeys(notes)),
        legend=tuple(legend) if planes else (),
        frame=bounds,
        view=_view(planes, surface),
    )


def _middle_plane(volume: FiberVolume, region: Region) -> SlicePlane:
    """Across the thinnest axis, through the middle of the fiber there."""
    axis = int(np.argmin(region.shape))
    axis = 2 if region.shape[2] == region.shape[axis] else axis
    amounts = np.zeros(int(region.shape[axis]))
    others = tuple(1 + i for i in range(3) if i != axis)
    for grid in volume.grids.values():
        per_layer = grid.density.reshape(-1, *[BRICK_SIZE] * 3).sum(axis=others)
        inside = (grid.origins[:, axis] >= region.low[axis]) & (grid.origins[:, axis] < region.high[axis])
        begin = grid.origins[inside, axis] - region.low[axis]
        np.add.at(amounts, begin[:, None] + np.arange(BRICK_SIZE), per_layer[inside])
    total = np.cumsum(amounts)
    layer = region.low[axis] + int(np.searchsorted(total, 0.5 * total[-1]))
    return SlicePlane(axis, (float(layer) + 0.5) * volume.voxel_size_mm)


def _slice_layers(volume: FiberVolume, region: Region, plane: SlicePlane) -> tuple[list[Layer], list[str]]:
    size, axis, letter = volume.voxel_size_mm, plane.axis, "xyz"[plane.axis]
    index = int(np.floor(plane.position_mm / size))
    if not region.low[axis] <= index < region.high[axis]:
        low, high = region.low[axis] * size, region.high[axis] * size
        what = f"--slice: {letter}={plane.position_mm:g} misses the grid"
        raise InputError(f"{what}; its {letter} goes from {low:.4g} to {high:.4g} mm")
    others = [i for i in range(3) if i != axis]
    stride = _stride(region.shape[others], SLICE_CELLS)
    values = grid_slice.density_plane(volume, region, axis, index, stride)
    layer = Slice(
        axis, plane.position_mm, values, region.low[others] * size, size * stride, _last_color(values)
    )
    note = f"slice {letter} = {plane.position_mm:.4g} mm, one voxel thick{_averaged(stride, 2)}"
    if layer.top < values.max():
        note += f"; values reach {values.max():.3g}, colors {layer.top:.3g}"
    every = -(-int(region.shape[others].max()) // GLYPHS_ALONG)
    axes = _axes(volume, region, axis, index, every)
    found = f"directions of every {_ordinal(every)} voxel" if every > 1 else "directions of all voxels"
    return [layer, axes], [note, found]


def _last_color(values: np.ndarray) -> float:
    """The largest value, or where few are much larger than the others what 99 % of them stay below."""
    filled = values[values > 0]
    if not filled.size:
        return 1.0
    most, common = float(filled.max()), float(np.percentile(filled, 99, method="lower"))
    return common if most > 1.25 * common else most


def _axes(volume: FiberVolume, region: Region, axis: int, index: int, every: int) -> Axes:
    """The directions lie in front of the slice, so that none is hidden in it."""
    length = 0.85 * every * volume.voxel_size_mm
    centers, directions, colors = [], [], []
    for medium, grid in enumerate(volume.grids.values()):
        place, direction = grid_slice.plane_directions(grid, region, axis, index, every)
        place[:, axis] += 0.5 * length
        centers.append(place)
        directions.append(direction)
        colors.append(np.broadcast_to(np.array(direction_color(medium), np.uint8), place.shape))
    return Axes(np.concatenate(centers), np.concatenate(directions), length, np.concatenate(colors))


def _surface(volume: FiberVolume, region: Region, level: float) -> tuple[Surface, int]:
    stride = _stride(region.shape, BLOCK_CELLS)
    block = grid_slice.density_block(volume, region, stride)
    if not block.min() < level < block.max():
        what = f"--surface: no surface at a volume fraction of {level:g}"
        raise InputError(f"{what}; values here go from {block.min():.3g} to {block.max():.3g}")
    size = volume.voxel_size_mm
    return Surface(block, region.low * size, size * stride, level, palette_color(0)), stride


def _stride(shape: np.ndarray, cells: int) -> int:
    """The finest averaging that keeps within `cells`."""
    for stride in STRIDES:
        if np.prod((shape // stride).astype(float)) <= cells:
            return stride
    voxels = " x ".join(f"{count:,}" for count in shape)
    raise InputError(f"the grid has {voxels} voxels, too many for one picture; choose a part with --box")


def _averaged(stride: int, dimensions: int) -> str:
    return "" if stride == 1 else f", averaged over {' x '.join([str(stride)] * dimensions)} voxels"


def _ordinal(number: int) -> str:
    ending = {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{'th' if number % 100 in (11, 12, 13) else ending}"


def _view(planes: tuple[SlicePlane, ...], surface: float | None) -> View:
    """Straight onto a single slice, else from a corner."""
    views: tuple[View, View, View] = ("side", "top", "front")
    return views[planes[0].axis] if len(planes) == 1 and surface is None else "iso"


def _summary(volume: FiberVolume) -> str:
    media = count_text(len(volume.media), "medium").replace("mediums", "media")
    return (
        f"{volume.voxel_count:,} voxels of {volume.voxel_size_mm:g} mm, {media}, "
        f"{length_text(volume.fiber_length_mm)} of fiber, {size_text(volume.bounds_mm)}"
    )
