# mypy: ignore-errors
"""The mean color of the fibers in each voxel of one tile, weighted by their length.

A pass of its own, for who asks for it: the segments are clipped as in kernels.py, and every piece adds its
length and its length times its color, as integers, so that their order does not show.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from .grid import BRICK_SIZE, BRICK_VOXELS
from .kernels import crossing_at
from .tile_sums import DEVICE, IS_SEGMENT, TilePlace

COLOR_SUMS = 4
"""Per voxel: length, and length times red, green and blue."""
COLOR_SUM_BYTES = 8 * COLOR_SUMS

wp.set_module_options({"enable_backward": False})

_BRICK_VOXELS = wp.constant(BRICK_VOXELS)
_COLOR_SUMS = wp.constant(COLOR_SUMS)
_IS_SEGMENT = wp.constant(wp.uint8(IS_SEGMENT))


@wp.struct
class ColorTile:
    """The color sums of one tile; as `kernels.TileSums`."""

    origin: wp.vec3i
    low: wp.vec3i
    high: wp.vec3i
    bricks_per_side: wp.int32
    inverse_voxel_size: wp.float32
    scale: wp.float32
    sums: wp.array(dtype=wp.int64)
    """Flat [brick, voxel, COLOR_SUMS]."""
    used: wp.array(dtype=wp.uint8)
    offsets: wp.array(dtype=wp.vec2)


@wp.func
def deposit_color(tile: ColorTile, voxel: wp.vec3i, units: wp.float32, color: wp.vec3):
    """Add one piece of `units` length to a voxel."""
    inside = True
    for k in range(3):
        if voxel[k] < tile.low[k] or voxel[k] >= tile.high[k]:
            inside = False
    if inside and wp.int64(units) > wp.int64(0):
        at = voxel - tile.origin
        side = tile.bricks_per_side
        brick = ((at[0] >> 3) * side + (at[1] >> 3)) * side + (at[2] >> 3)
        local = ((at[0] & 7) << 6) | ((at[1] & 7) << 3) | (at[2] & 7)
        first = (brick * _BRICK_VOXELS + local) * _COLOR_SUMS
        tile.used[brick] = wp.uint8(1)
        wp.atomic_add(tile.sums, first, wp.int64(units))
        for k in range(3):
            wp.atomic_add(tile.sums, first + 1 + k, wp.int64(units * color[k]))


@wp.func
def color_line(tile: ColorTile, a: wp.vec3, b: wp.vec3, color: wp.vec3):
    """Clip the line from a to b [mm] against the voxel faces and add its pieces."""
    p = a * tile.inverse_voxel_size
    d = (b - a) * tile.inverse_voxel_size
    voxel = wp.vec3i(0, 0, 0)
    step = wp.vec3i(0, 0, 0)
    left = wp.vec3i(0, 0, 0)
    face = wp.vec3(0.0, 0.0, 0.0)
    next = wp.vec3(0.0, 0.0, 0.0)
    crossings = wp.int32(0)
    for k in range(3):
        last = int(wp.floor(b[k] * tile.inverse_voxel_size))
        voxel[k] = int(wp.floor(p[k]))
        if wp.max(voxel[k], last) < tile.low[k] or wp.min(voxel[k], last) >= tile.high[k]:
            return
        step[k] = wp.where(last > voxel[k], 1, -1)
        left[k] = wp.abs(last - voxel[k])
        face[k] = wp.float32(wp.max(voxel[k], voxel[k] + wp.where(last > voxel[k], 1, 0)))
        next[k] = crossing_at(face[k], p[k], 1.0 / d[k], left[k])
        crossings += left[k]
    units = wp.length(d) * tile.scale
    reached = wp.float32(0.0)
    for crossing in range(crossings + 1):
        axis = wp.int32(2)
        if next[0] <= next[1] and next[0] <= next[2]:
            axis = wp.int32(0)
        elif next[1] <= next[2]:
            axis = wp.int32(1)
        until = wp.float32(1.0)
        if crossing < crossings:
            until = wp.clamp(next[axis], reached, 1.0)
        deposit_color(tile, voxel, (until - reached) * units + 0.5, color)
        reached = until
        voxel[axis] += step[axis]
        left[axis] -= 1
        face[axis] += wp.float32(step[axis])
        next[axis] = crossing_at(face[axis], p[axis], 1.0 / d[axis], left[axis])


@wp.func
def across_line(a: wp.vec3, b: wp.vec3, offset: wp.vec2):
    """Where a line that stands for a fiber lies against its middle [mm]. Frame after Duff et al. 2017."""
    t = wp.normalize(b - a)
    sign = wp.where(t[2] < 0.0, -1.0, 1.0)
    c = -1.0 / (sign + t[2])
    d = t[0] * t[1] * c
    u = wp.vec3(1.0 + sign * t[0] * t[0] * c, sign * d, -sign * t[0])
    v = wp.vec3(d, sign + t[1] * t[1] * c, -t[1])
    return u * offset[0] + v * offset[1]


@wp.kernel
def add_colors(
    tile: ColorTile,
    points: wp.array(dtype=wp.vec3),
    colors: wp.array(dtype=wp.vec3),
    flags: wp.array(dtype=wp.uint8),
):
    """One thread per segment, from its point to the next; its color is the mean of theirs."""
    i = wp.tid()
    if (flags[i] & _IS_SEGMENT) == wp.uint8(0):
        return
    a = points[i]
    b = points[i + 1]
    if not wp.length(b - a) > 0.0:
        return
    color = 0.5 * (colors[i] + colors[i + 1])
    for k in range(tile.offsets.shape[0]):
        o = across_line(a, b, tile.offsets[k])
        color_line(tile, a + o, b + o, color)


class ColorAccumulator:
    """Color sums for all voxels of one tile, used for tile after tile by one worker."""

    def __init__(self, tile_voxels: int) -> None:
        self._side = tile_voxels // BRICK_SIZE
        # fresh zero pages cost nothing until fibers reach their brick
        self._sums = np.zeros((self._side**3, BRICK_VOXELS, COLOR_SUMS), dtype=np.int64)
        self._used = np.zeros(self._side**3, dtype=np.uint8)
        self._tile = ColorTile()

    def open(self, place: TilePlace) -> None:
        """Begin the tile at a place."""
        tile = self._tile
        tile.origin = wp.vec3i(*place.origin.tolist())
        tile.low, tile.high = wp.vec3i(*place.low.tolist()), wp.vec3i(*place.high.tolist())
        tile.bricks_per_side = self._side
        tile.inverse_voxel_size = 1.0 / place.voxel_size_mm
        tile.scale = place.scale
        tile.sums, tile.used = _shared(self._sums.reshape(-1), wp.int64), _shared(self._used, wp.uint8)
        tile.offsets = _shared(place.lines, wp.vec2)

    def add(self, points: np.ndarray, colors: np.ndarray, flags: np.ndarray) -> None:
        """Segments from each point to the next where the flags say so."""
        inputs = [_shared(points, wp.vec3), _shared(colors, wp.vec3), _shared(flags, wp.uint8)]
        wp.launch(add_colors, len(flags), inputs=[self._tile, *inputs], device=DEVICE)

    def resolve(self, bricks: np.ndarray, density: np.ndarray) -> np.ndarray:
        """Mean colors of these bricks where there is density, else 0; the sums are clear afterwards.

        Fibers without a color are white.
        """
        sums = self._sums[bricks].astype(np.float64)
        length = sums[..., :1]
        means = np.divide(sums[..., 1:], length, out=np.ones_like(sums[..., 1:]), where=length > 0)
        used = np.flatnonzero(self._used)
        self._sums[used], self._used[used] = 0, 0
        return np.where(density[..., None] > 0, means, 0).astype(np.float32)


def load_color_kernels() -> None:
    """Compile them before threads ask for them."""
    import sys

    wp.load_module(sys.modules[__name__], device=DEVICE)


def _shared(array: np.ndarray, dtype: type) -> wp.array:
    return wp.array(np.ascontiguousarray(array), dtype=dtype, device=DEVICE, copy=False)
