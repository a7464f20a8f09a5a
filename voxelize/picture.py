"""A picture of a whole volume on the disk, cube of bricks after cube of bricks: memory holds the picture.

Seen across the thinnest side, from the front. Light stops as the fibers' extinction says; slopes of what is
seen are lit from the upper left, so that yarns stand out. It is no rendering: nothing is scattered twice, and
nothing throws a shadow.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import warp as wp

from weft.files.atomic import atomic_write

from . import picture_kernels
from .grid import BRICK_SIZE
from .level_of_detail import blocks_of
from .stored import StoredVolume
from .tile_sums import DEVICE

SIDE = 16
"""Bricks along the edge of a cube."""
MOST_PIXELS = 1 << 24
LARGEST_SIDE = 1600
"""Of the picture that is written."""
LIGHT = (-0.45, 0.55, 0.7)
"""Toward the light, in the picture: right, up, toward the viewer."""
AMBIENT = 0.3
BAND = 64
"""Columns that are shaded at a time, so that the images themselves are what takes memory."""
FIBER_COLOR = (0.86, 0.80, 0.70)
BACKGROUND = (0.055, 0.06, 0.07)
STRIDES = (1, 2, 4, 8)
ORIENTATION = ((2, 1, (-1, 1)), (0, 2, (1, -1)), (0, 1, (1, 1)))
"""By the axis looked along: the axes to the right and up in the picture, and their signs."""


def draw_volume(path: Path, volume: StoredVolume) -> None:
    """Write the picture of a volume as a .png."""
    layers, height_mm_per_pixel = _march(volume)
    levels = _shade(*layers, height_mm_per_pixel)
    from PIL import Image

    image = Image.fromarray(levels)
    shrink = max(image.size) / LARGEST_SIDE
    if shrink > 1:
        image = image.resize([max(round(n / shrink), 1) for n in image.size], Image.Resampling.BOX)
    with atomic_write(path) as temporary:
        image.save(temporary, format="PNG")


def _march(volume: StoredVolume) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray], float]:
    """Transmittance, light and mean height of what is seen per pixel, each [u, v]; and voxels per pixel."""
    bounds = np.rint(volume.bounds_mm / volume.voxel_size_mm).astype(np.int64)
    cube = BRICK_SIZE * SIDE
    low, high = bounds[0] // cube * cube, -(-bounds[1] // cube) * cube
    axis = int(np.argmin(bounds[1] - bounds[0]))
    across = [(axis + 1) % 3, (axis + 2) % 3]
    extent = (high - low)[across]
    stride = next((s for s in STRIDES if np.prod(extent // s) <= MOST_PIXELS), STRIDES[-1])
    shape = tuple(int(n) for n in extent // stride)
    transmittance = np.ones(shape, dtype=np.float32)
    light, height = np.zeros_like(transmittance), np.zeros_like(transmittance)
    images = [_shared(image, wp.float32) for image in (transmittance, light, height)]
    view = picture_kernels.View()
    view.axis, view.stride = axis, stride
    toward = np.zeros(3)
    right, up, flips = ORIENTATION[axis]
    toward[[right, up, axis]] = np.array(LIGHT) * [*flips, 1]
    view.light = wp.vec3(*(toward / np.linalg.norm(toward)).tolist())
    jobs = [
        (-int(grid.origins[rows[0], axis] // cube), order, rows)
        for order, grid in enumerate(volume.grids.values())
        for rows in blocks_of(grid.origins, SIDE)
    ]
    grids = list(volume.grids.values())
    # front to back; of media in the same cube the first one hides the others a little too much
    for _, order, rows in sorted(jobs, key=lambda job: job[:2]):
        grid = grids[order]
        view.depth_per_density = 2 * grid.voxel_size_mm / (math.pi * grid.fiber_radius_mm)
        corner = grid.origins[rows[0]] // cube * cube
        values = grid.read(rows)
        table = np.full(SIDE**3, -1, dtype=np.int32)
        place = (grid.origins[rows] - corner) // BRICK_SIZE
        table[np.ravel_multi_index(tuple(place.T), (SIDE,) * 3)] = np.arange(len(rows))
        first = (corner - low)[across] // stride
        wp.launch(
            picture_kernels.add_cube,
            dim=(cube // stride, cube // stride),
            inputs=[view, SIDE, _shared(table, wp.int32), _shared(values["density"], wp.float32)],
            outputs=[
                _shared(values["direction"], wp.vec3),
                wp.vec2i(*first.tolist()),
                int(corner[axis]),
                *images,
            ],
            device=DEVICE,
        )
    turned = [layer if axis == 2 else layer.T for layer in (transmittance, light, height)]
    a, b, c = (layer[:: flips[0], :: flips[1]] for layer in turned)
    return (a, b, c), float(stride)


def _shade(
    transmittance: np.ndarray, light: np.ndarray, height: np.ndarray, voxels_per_pixel: float
) -> np.ndarray:
    """sRGB, uint8, shape [rows, columns, 3], cropped to what is seen; from images [right, up], in bands."""
    spans = [np.flatnonzero((1 - transmittance > 0.02).any(axis=k)) for k in (1, 0)]
    (left, right), (bottom, top) = [
        (int(span[0]), int(span[-1]) + 1) if len(span) else (0, n)
        for span, n in zip(spans, transmittance.shape, strict=True)
    ]
    levels = np.empty((right - left, top - bottom, 3), dtype=np.uint8)
    for start in range(left, right, BAND):
        stop = min(start + BAND, right)
        # slopes need the neighbors of the band
        first, last = max(start - 1, 0), min(stop + 1, len(transmittance))
        band = slice(first, last)
        shaded = _shade_band(transmittance[band], light[band], height[band], voxels_per_pixel)
        levels[start - left : stop - left] = shaded[start - first : stop - first, bottom:top]
    return np.ascontiguousarray(levels.transpose(1, 0, 2)[::-1])


def _shade_band(
    transmittance: np.ndarray, light: np.ndarray, height: np.ndarray, voxels_per_pixel: float
) -> np.ndarray:
    seen = 1 - transmittance
    solid = np.maximum(seen, 1e-3)
    mean = np.where(seen > 0.02, height / solid, np.nan)
    slopes = [np.nan_to_num(np.gradient(mean, axis=k)) / voxels_per_pixel for k in (0, 1)]
    normal = np.stack([-slopes[0], -slopes[1], np.full_like(slopes[0], 1.5)])
    facing = np.tensordot(np.array(LIGHT) / np.linalg.norm(LIGHT), normal, axes=1)
    facing = np.clip(facing / np.linalg.norm(normal, axis=0), 0, 1)
    brightness = light * (AMBIENT + (1 - AMBIENT) * facing)
    linear = brightness[..., None] * np.array(FIBER_COLOR) + transmittance[..., None] * np.array(BACKGROUND)
    return np.rint(np.clip(linear, 0, 1) ** (1 / 2.2) * 255).astype(np.uint8)


def _shared(array: np.ndarray, dtype: type) -> wp.array:
    return wp.array(np.ascontiguousarray(array), dtype=dtype, device=DEVICE, copy=False)
