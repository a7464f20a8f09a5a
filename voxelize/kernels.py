# mypy: ignore-errors
"""Warp kernels: exact clipping of fiber segments against voxel faces, then density and direction.

Amanatides and Woo 1987, walked along the segment: every voxel receives the length l of the piece inside it
and the second moment l t t^T of the piece's direction t. Sums are integers, so their order does not matter:
any split into tiles, threads or launches gives the same bits. Twin: tile_extension/, in C++ for the CPU.
"""

from __future__ import annotations

import warp as wp

from .axis_kernels import hemisphere, largest_eigenvector
from .grid import BRICK_VOXELS
from .tile_sums import IS_MEASURED, MEASURE_UNITS

SUM_COUNT = 6
"""Integer sums per voxel: l and l times xx, yy, xy, xz, yz of t t^T; zz is what is left of l."""


# the twins in tile_extension/ round every operation by itself, and so does this
wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_BRICK_VOXELS = wp.constant(BRICK_VOXELS)
_SUM_COUNT = wp.constant(SUM_COUNT)
_MEASURE_UNITS = wp.constant(wp.float64(MEASURE_UNITS))
_IS_MEASURED = wp.constant(wp.uint8(IS_MEASURED))
_NEVER = wp.constant(2.0)
"""A segment parameter beyond its end (0 is its start, 1 its end)."""


@wp.struct
class TileSums:
    """The accumulators of one tile, a cube of whole bricks."""

    origin: wp.vec3i
    """First voxel of the tile, a multiple of 8."""
    low: wp.vec3i
    """First voxel that takes part; a region may cut the tile."""
    high: wp.vec3i
    """One past the last voxel that takes part."""
    bricks_per_side: wp.int32
    inverse_voxel_size: wp.float32
    """[1/mm]"""
    scale: wp.float32
    """Integer units that a voxel size of length counts in each of a fiber's lines."""
    sums: wp.array(dtype=wp.int64)
    """Flat [brick, voxel, SUM_COUNT]; the brick index is (x * n + y) * n + z with n bricks per side."""
    used: wp.array(dtype=wp.uint8)
    """1 for each brick that received something."""
    offsets: wp.array(dtype=wp.vec2)
    """Where the lines that stand for a fiber pierce its cross-section [mm]; see coverage.py."""


@wp.func
def deposit(tile: TileSums, voxel: wp.vec3i, units: wp.float32, squares: wp.vec3, products: wp.vec3):
    """Add one piece of `units` length to a voxel, given relative to the tile's origin.

    squares = (t_x t_x, t_y t_y, -), products = (t_x t_y, t_x t_z, t_y t_z).
    """
    if units >= 1.0:
        length = wp.int64(units)
        brick = ((voxel[0] >> 3) * tile.bricks_per_side + (voxel[1] >> 3)) * tile.bricks_per_side + (
            voxel[2] >> 3
        )
        local = ((voxel[0] & 7) << 6) | ((voxel[1] & 7) << 3) | (voxel[2] & 7)
        first = (brick * _BRICK_VOXELS + local) * _SUM_COUNT
        tile.used[brick] = wp.uint8(1)
        wp.atomic_add(tile.sums, first, length)
        wp.atomic_add(tile.sums, first + 1, wp.int64(units * squares[0]))
        wp.atomic_add(tile.sums, first + 2, wp.int64(units * squares[1]))
        wp.atomic_add(tile.sums, first + 3, wp.int64(units * products[0]))
        wp.atomic_add(tile.sums, first + 4, wp.int64(units * products[1]))
        wp.atomic_add(tile.sums, first + 5, wp.int64(units * products[2]))


@wp.func
def crossing_at(face: wp.float32, start: wp.float32, inverse: wp.float32, left: int):
    """Segment parameter of the next voxel face along one axis; `_NEVER` where none is left.

    It may be infinite or not a number where the segment hardly moves along the axis: never the smallest.
    """
    if left > 0:
        return (face - start) * inverse
    return float(_NEVER)


@wp.func
def accumulate_line(tile: TileSums, a: wp.vec3, b: wp.vec3, step: wp.vec3):
    """Clip the line from a to b [mm] against the voxel faces and add its pieces to the tile.

    `step` is b - a before both were moved. Every piece is computed from the whole segment, never from where
    it enters the tile, so that a piece has the same bits whichever tile asks for it.
    """
    p = a * tile.inverse_voxel_size
    q = b * tile.inverse_voxel_size
    # not q - p: the difference of the points is exact, so that length is conserved far from the origin too
    d = step * tile.inverse_voxel_size
    voxel = wp.vec3i(int(wp.floor(p[0])), int(wp.floor(p[1])), int(wp.floor(p[2])))
    last = wp.vec3i(int(wp.floor(q[0])), int(wp.floor(q[1])), int(wp.floor(q[2])))
    for k in range(3):
        if wp.max(voxel[k], last[k]) < tile.low[k] or wp.min(voxel[k], last[k]) >= tile.high[k]:
            return
    length = wp.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    if not length > 0.0:
        return
    part = 1.0 / length
    t = wp.vec3(d[0] * part, d[1] * part, d[2] * part)
    squares = wp.vec3(t[0] * t[0], t[1] * t[1], 0.0)
    products = wp.vec3(t[0] * t[1], t[0] * t[2], t[1] * t[2])
    length_units = length * tile.scale

    ix = voxel[0]
    iy = voxel[1]
    iz = voxel[2]
    left_x = wp.abs(last[0] - ix)
    left_y = wp.abs(last[1] - iy)
    left_z = wp.abs(last[2] - iz)
    step_x = wp.where(last[0] > ix, 1, -1)
    step_y = wp.where(last[1] > iy, 1, -1)
    step_z = wp.where(last[2] > iz, 1, -1)
    face_x = float(wp.where(last[0] > ix, ix + 1, ix))
    face_y = float(wp.where(last[1] > iy, iy + 1, iy))
    face_z = float(wp.where(last[2] > iz, iz + 1, iz))
    inverse = wp.vec3(1.0 / d[0], 1.0 / d[1], 1.0 / d[2])
    next_x = crossing_at(face_x, p[0], inverse[0], left_x)
    next_y = crossing_at(face_y, p[1], inverse[1], left_y)
    next_z = crossing_at(face_z, p[2], inverse[2], left_z)
    crossings = left_x + left_y + left_z
    reached = wp.float32(0.0)
    for crossing in range(crossings + 1):
        along_x = next_x <= next_y and next_x <= next_z
        along_y = not along_x and next_y <= next_z
        # rounding may put a face a hair before the previous one or behind the end
        until = wp.where(along_x, next_x, wp.where(along_y, next_y, next_z))
        until = wp.where(until > reached, until, reached)
        until = wp.where(until < 1.0, until, 1.0)
        until = wp.where(crossing == crossings, 1.0, until)
        if (
            ix >= tile.low[0]
            and iy >= tile.low[1]
            and iz >= tile.low[2]
            and ix < tile.high[0]
            and iy < tile.high[1]
            and iz < tile.high[2]
        ):
            units = (until - reached) * length_units + 0.5
            deposit(tile, wp.vec3i(ix, iy, iz) - tile.origin, units, squares, products)
        reached = until
        if along_x:
            ix += step_x
            left_x -= 1
            face_x += float(step_x)
            next_x = crossing_at(face_x, p[0], inverse[0], left_x)
        elif along_y:
            iy += step_y
            left_y -= 1
            face_y += float(step_y)
            next_y = crossing_at(face_y, p[1], inverse[1], left_y)
        else:
            iz += step_z
            left_z -= 1
            face_z += float(step_z)
            next_z = crossing_at(face_z, p[2], inverse[2], left_z)


@wp.func
def clipped_length(a: wp.vec3, b: wp.vec3, low: wp.vec3d, high: wp.vec3d):
    """Length of the part of a segment inside a box [mm], after Liang and Barsky 1984."""
    start = wp.vec3d(a)
    d = wp.vec3d(b) - start
    enter = wp.float64(0.0)
    leave = wp.float64(1.0)
    for axis in range(3):
        if d[axis] == wp.float64(0.0):
            if start[axis] < low[axis] or start[axis] > high[axis]:
                return wp.float64(0.0)
        else:
            u = (low[axis] - start[axis]) / d[axis]
            v = (high[axis] - start[axis]) / d[axis]
            enter = wp.max(enter, wp.min(u, v))
            leave = wp.min(leave, wp.max(u, v))
    return wp.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]) * wp.max(leave - enter, wp.float64(0.0))


@wp.func
def line_offset(tile: TileSums, k: int, a: wp.vec3, b: wp.vec3):
    """Line `k` of a segment lies this far from it [mm], at right angles. Frame after Duff et al. 2017."""
    s = b - a
    length = wp.sqrt(s[0] * s[0] + s[1] * s[1] + s[2] * s[2])
    inverse = wp.where(length > 0.0, 1.0 / length, 0.0)
    t = wp.vec3(s[0] * inverse, s[1] * inverse, s[2] * inverse)
    sign = wp.where(t[2] < 0.0, -1.0, 1.0)
    c = -1.0 / (sign + t[2])
    d = t[0] * t[1] * c
    u = wp.vec3(1.0 + sign * t[0] * t[0] * c, sign * d, -sign * t[0])
    v = wp.vec3(d, sign + t[1] * t[1] * c, -t[1])
    return u * tile.offsets[k][0] + v * tile.offsets[k][1]


@wp.func
def accumulate_segment(tile: TileSums, a: wp.vec3, b: wp.vec3):
    """Add a fiber's segment from a to b [mm] to the tile, as its lines."""
    lines = tile.offsets.shape[0]
    if lines == 1:
        accumulate_line(tile, a, b, b - a)
    else:
        for k in range(lines):
            o = line_offset(tile, k, a, b)
            accumulate_line(tile, a + o, b + o, b - a)


@wp.func
def lies_within(tile: TileSums, a: wp.vec3, b: wp.vec3, low: wp.vec3d, high: wp.vec3d):
    """Whether a segment and its lines lie well inside a box [mm]."""
    margin = wp.float64(0.0)
    for k in range(tile.offsets.shape[0]):
        o = tile.offsets[k]
        margin = wp.max(margin, wp.float64(2.0) * wp.float64(wp.max(wp.abs(o[0]), wp.abs(o[1]))))
    for axis in range(3):
        if wp.float64(wp.min(a[axis], b[axis])) - margin <= low[axis]:
            return False
        if wp.float64(wp.max(a[axis], b[axis])) + margin >= high[axis]:
            return False
    return True


@wp.func
def segment_length_within(tile: TileSums, a: wp.vec3, b: wp.vec3, low: wp.vec3d, high: wp.vec3d):
    """Length [mm] of a segment inside a box, the mean of its lines'."""
    if lies_within(tile, a, b, low, high):
        x = wp.float64(b[0]) - wp.float64(a[0])
        y = wp.float64(b[1]) - wp.float64(a[1])
        z = wp.float64(b[2]) - wp.float64(a[2])
        return wp.sqrt(x * x + y * y + z * z)
    lines = tile.offsets.shape[0]
    if lines == 1:
        return clipped_length(a, b, low, high)
    total = wp.float64(0.0)
    for k in range(lines):
        o = line_offset(tile, k, a, b)
        total += clipped_length(a + o, b + o, low, high)
    return total / wp.float64(lines)


@wp.kernel
def accumulate_points(
    tile: TileSums,
    points: wp.array(dtype=wp.vec3),
    flags: wp.array(dtype=wp.uint8),
    stride: wp.int32,
    order: wp.array(dtype=wp.int32),
    region_low: wp.vec3d,
    region_high: wp.vec3d,
    length: wp.array(dtype=wp.int64),
):
    """One thread adds one segment, from points[i * stride] to the point after it [mm].

    flags[i] is 0 where there is no segment; bit 0 means that it is added, bit 1 that `length` receives its
    length within the region, in MEASURE_UNITS. Where `order` is not empty it names the segments to take.
    """
    i = wp.tid()
    if flags[i] == wp.uint8(0):
        return
    begin = i
    if order.shape[0] > 0:
        begin = order[i]
    a = points[begin * stride]
    b = points[begin * stride + 1]
    accumulate_segment(tile, a, b)
    if (flags[i] & _IS_MEASURED) != wp.uint8(0):
        length[i] = wp.int64(segment_length_within(tile, a, b, region_low, region_high) * _MEASURE_UNITS)


@wp.kernel
def resolve_bricks(
    sums: wp.array(dtype=wp.int64),
    bricks: wp.array(dtype=wp.int32),
    density_per_unit: wp.float64,
    density: wp.array2d(dtype=wp.float32),
    direction: wp.array2d(dtype=wp.vec3),
    moment_diag: wp.array2d(dtype=wp.vec3),
    moment_off: wp.array2d(dtype=wp.vec3),
):  # fmt: skip
    """Density and direction of the listed bricks from their sums, which are cleared for the next tile.

    The second moment is written where its arrays are not empty.
    """
    row, voxel = wp.tid()
    first = (bricks[row] * _BRICK_VOXELS + voxel) * _SUM_COUNT
    length = sums[first]
    if length > wp.int64(0):
        unit = wp.float64(1.0) / wp.float64(length)
        xx = wp.float64(sums[first + 1]) * unit
        yy = wp.float64(sums[first + 2]) * unit
        zz = wp.float64(length - sums[first + 1] - sums[first + 2]) * unit
        xy = wp.float64(sums[first + 3]) * unit
        xz = wp.float64(sums[first + 4]) * unit
        yz = wp.float64(sums[first + 5]) * unit
        axis = largest_eigenvector(wp.vec3d(xx, yy, zz), wp.vec3d(xy, xz, yz))
        density[row, voxel] = wp.float32(wp.float64(length) * density_per_unit)
        direction[row, voxel] = hemisphere(
            wp.vec3(wp.float32(axis[0]), wp.float32(axis[1]), wp.float32(axis[2]))
        )
        if moment_diag.shape[0] > 0:
            moment_diag[row, voxel] = wp.vec3(wp.float32(xx), wp.float32(yy), wp.float32(zz))
            moment_off[row, voxel] = wp.vec3(wp.float32(xy), wp.float32(xz), wp.float32(yz))
        for k in range(_SUM_COUNT):
            sums[first + k] = wp.int64(0)
    else:
        density[row, voxel] = 0.0
        direction[row, voxel] = wp.vec3(0.0, 0.0, 0.0)
        if moment_diag.shape[0] > 0:
            moment_diag[row, voxel] = wp.vec3(0.0, 0.0, 0.0)
            moment_off[row, voxel] = wp.vec3(0.0, 0.0, 0.0)
