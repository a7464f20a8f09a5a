# mypy: ignore-errors
"""Warp kernels: exact clipping of fiber segments against voxel faces, then density and direction.

Amanatides and Woo 1987, walked along the segment: every voxel receives the length l of the piece inside it
and the second moment l t t^T of the piece's direction t. Sums are integers, so their order does not matter:
any split into tiles, threads or launches gives the same bits.
"""

from __future__ import annotations

import warp as wp

from weft.fiber_model.fiber_kernels import FiberTables, open_strand, open_strand_point

from .grid import BRICK_VOXELS

SUM_COUNT = 6
"""Integer sums per voxel: l and l times xx, yy, xy, xz, yz of t t^T; zz is what is left of l."""

LENGTH_UNITS = 2.0**32
"""Integer units per voxel size: 2^-32 of a voxel resolved, 2^31 voxel lengths of fiber per voxel held."""

MEASURE_UNITS = 2.0**32
"""Integer units per mm when the generated length is added up."""

wp.set_module_options({"enable_backward": False})

_BRICK_VOXELS = wp.constant(BRICK_VOXELS)
_SUM_COUNT = wp.constant(SUM_COUNT)
_LENGTH_UNITS = wp.constant(LENGTH_UNITS)
_MEASURE_UNITS = wp.constant(wp.float64(MEASURE_UNITS))
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
    length = wp.int64(units)
    if length > wp.int64(0):
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
def crossing_at(start: wp.float32, inverse: wp.float32, voxel: int, last: int):
    """Segment parameter of the next voxel face along one axis; `_NEVER` once the last voxel is reached.

    It may be infinite or not a number where the segment hardly moves along the axis: never the smallest.
    """
    if voxel == last:
        return float(_NEVER)
    return (float(wp.max(voxel, voxel + wp.sign(last - voxel))) - start) * inverse


@wp.func
def accumulate_line(tile: TileSums, a: wp.vec3, b: wp.vec3, step: wp.vec3, units: wp.float32):
    """Clip the line from a to b [mm] against the voxel faces and add its pieces to the tile.

    `step` is b - a before both were moved, `units` what a voxel size of length counts. Every piece is
    computed from the whole segment, never from where it enters the tile, so that a piece has the same bits
    whichever tile asks for it.
    """
    p = a * tile.inverse_voxel_size
    q = b * tile.inverse_voxel_size
    # not q - p: the difference of the points is exact, so that length is conserved far from the origin too
    d = step * tile.inverse_voxel_size
    ix = int(wp.floor(p[0]))
    iy = int(wp.floor(p[1]))
    iz = int(wp.floor(p[2]))
    jx = int(wp.floor(q[0]))
    jy = int(wp.floor(q[1]))
    jz = int(wp.floor(q[2]))
    if wp.max(ix, jx) < tile.low[0] or wp.max(iy, jy) < tile.low[1] or wp.max(iz, jz) < tile.low[2]:
        return
    if wp.min(ix, jx) >= tile.high[0] or wp.min(iy, jy) >= tile.high[1] or wp.min(iz, jz) >= tile.high[2]:
        return
    length = wp.length(d)
    if not length > 0.0:
        return
    t = d / length
    squares = wp.cw_mul(t, t)
    products = wp.vec3(t[0] * t[1], t[0] * t[2], t[1] * t[2])
    length_units = length * units
    inverse = wp.vec3(1.0 / d[0], 1.0 / d[1], 1.0 / d[2])

    next_x = crossing_at(p[0], inverse[0], ix, jx)
    next_y = crossing_at(p[1], inverse[1], iy, jy)
    next_z = crossing_at(p[2], inverse[2], iz, jz)
    crossings = wp.abs(jx - ix) + wp.abs(jy - iy) + wp.abs(jz - iz)
    reached = wp.float32(0.0)
    for crossing in range(crossings + 1):
        until = wp.float32(1.0)
        if crossing < crossings:
            # rounding may put a face a hair before the previous one or behind the end
            until = wp.clamp(wp.min(next_x, wp.min(next_y, next_z)), reached, 1.0)
        if (
            ix >= tile.low[0]
            and iy >= tile.low[1]
            and iz >= tile.low[2]
            and ix < tile.high[0]
            and iy < tile.high[1]
            and iz < tile.high[2]
        ):
            deposit(
                tile, wp.vec3i(ix, iy, iz) - tile.origin, (until - reached) * length_units, squares, products
            )
        reached = until
        if next_x <= next_y and next_x <= next_z:
            ix += wp.sign(jx - ix)
            next_x = crossing_at(p[0], inverse[0], ix, jx)
        elif next_y <= next_z:
            iy += wp.sign(jy - iy)
            next_y = crossing_at(p[1], inverse[1], iy, jy)
        else:
            iz += wp.sign(jz - iz)
            next_z = crossing_at(p[2], inverse[2], iz, jz)


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
    return wp.length(d) * wp.max(leave - enter, wp.float64(0.0))


@wp.func
def line_offset(tile: TileSums, k: int, a: wp.vec3, b: wp.vec3):
    """Line `k` of a segment lies this far from it [mm], at right angles. Frame after Duff et al. 2017."""
    t = wp.normalize(b - a)
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
        accumulate_line(tile, a, b, b - a, _LENGTH_UNITS)
    else:
        part = _LENGTH_UNITS / float(lines)
        for k in range(lines):
            o = line_offset(tile, k, a, b)
            accumulate_line(tile, a + o, b + o, b - a, part)


@wp.func
def segment_length_within(tile: TileSums, a: wp.vec3, b: wp.vec3, low: wp.vec3d, high: wp.vec3d):
    """Length [mm] of a segment inside a box, the mean of its lines'."""
    lines = tile.offsets.shape[0]
    if lines == 1:
        return clipped_length(a, b, low, high)
    total = wp.float64(0.0)
    for k in range(lines):
        o = line_offset(tile, k, a, b)
        total += clipped_length(a + o, b + o, low, high)
    return total / wp.float64(lines)


@wp.kernel
def accumulate_segments(
    tile: TileSums,
    segments: wp.array2d(dtype=wp.vec3),
    chosen: wp.array(dtype=wp.int32),
    measured: wp.array(dtype=wp.uint8),
    region_low: wp.vec3d,
    region_high: wp.vec3d,
    length: wp.array(dtype=wp.int64),
):
    """One thread adds one of the chosen segments, shape [segment_count, 2] [mm].

    Where `measured`, `length` receives the length within the region, in MEASURE_UNITS.
    """
    i = wp.tid()
    a = segments[chosen[i], 0]
    b = segments[chosen[i], 1]
    accumulate_segment(tile, a, b)
    if measured[i] != wp.uint8(0):
        length[i] = wp.int64(segment_length_within(tile, a, b, region_low, region_high) * _MEASURE_UNITS)


@wp.kernel
def accumulate_fibers(
    tile: TileSums,
    tables: FiberTables,
    stretches: wp.array(dtype=wp.int32),
    strands: wp.array(dtype=wp.int32),
    measured: wp.array(dtype=wp.uint8),
    region_low: wp.vec3d,
    region_high: wp.vec3d,
    length: wp.array(dtype=wp.int64),
):
    """One thread makes one strand of one stretch and adds its segments; else as `accumulate_segments`."""
    i = wp.tid()
    strand = open_strand(tables, stretches[i], strands[i])
    total = wp.float64(0.0)
    before = open_strand_point(tables, strand, 0)
    for k in range(1, strand.segments + 1):
        point = open_strand_point(tables, strand, k)
        accumulate_segment(tile, before, point)
        if measured[i] != wp.uint8(0):
            total += segment_length_within(tile, before, point, region_low, region_high)
        before = point
    length[i] = wp.int64(total * _MEASURE_UNITS)


@wp.func
def axis_in_plane(diagonal: wp.vec3d, row_x: wp.vec3d, row_y: wp.vec3d, row_z: wp.vec3d):
    """The axis of two equal largest eigenvalues: any in their plane; this is the one nearest the coordinate
    axis of the largest diagonal element. The rows of A - lambda I are normal to the plane.
    """
    normal = row_x
    if wp.length_sq(row_y) > wp.length_sq(normal):
        normal = row_y
    if wp.length_sq(row_z) > wp.length_sq(normal):
        normal = row_z
    normal = wp.normalize(normal)
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    axis = wp.vec3d(one, zero, zero)
    if diagonal[1] > diagonal[0] and diagonal[1] >= diagonal[2]:
        axis = wp.vec3d(zero, one, zero)
    elif diagonal[2] > diagonal[0]:
        axis = wp.vec3d(zero, zero, one)
    return wp.normalize(axis - normal * wp.dot(normal, axis))


@wp.func
def largest_eigenvector(diagonal: wp.vec3d, off: wp.vec3d):
    """Unit eigenvector of the largest eigenvalue of a symmetric 3 x 3 matrix; off = (xy, xz, yz).

    Closed form: Smith 1961 for the eigenvalue, then the longest cross product of two rows of A - lambda I.
    """
    third = wp.float64(1.0) / wp.float64(3.0)
    mean = (diagonal[0] + diagonal[1] + diagonal[2]) * third
    x = diagonal[0] - mean
    y = diagonal[1] - mean
    z = diagonal[2] - mean
    squared = wp.dot(off, off)
    spread = wp.sqrt((x * x + y * y + z * z + wp.float64(2.0) * squared) / wp.float64(6.0))
    if spread < wp.float64(1.0e-12):
        return wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
    determinant = (
        x * (y * z - off[2] * off[2])
        - off[0] * (off[0] * z - off[2] * off[1])
        + off[1] * (off[0] * off[2] - y * off[1])
    )
    cosine = wp.clamp(
        wp.float64(0.5) * determinant / (spread * spread * spread), wp.float64(-1.0), wp.float64(1.0)
    )
    shift = wp.float64(2.0) * spread * wp.cos(wp.acos(cosine) * third)
    row_x = wp.vec3d(x - shift, off[0], off[1])
    row_y = wp.vec3d(off[0], y - shift, off[2])
    row_z = wp.vec3d(off[1], off[2], z - shift)
    best = wp.cross(row_x, row_y)
    second = wp.cross(row_x, row_z)
    if wp.length_sq(second) > wp.length_sq(best):
        best = second
    third_product = wp.cross(row_y, row_z)
    if wp.length_sq(third_product) > wp.length_sq(best):
        best = third_product
    if wp.length_sq(best) > wp.float64(1.0e-24) * spread * spread * spread * spread:
        return wp.normalize(best)
    return axis_in_plane(diagonal, row_x, row_y, row_z)


@wp.func
def hemisphere(axis: wp.vec3):
    """The one of axis and -axis whose last nonzero component is positive."""
    flip = axis[2] < 0.0 or (axis[2] == 0.0 and (axis[1] < 0.0 or (axis[1] == 0.0 and axis[0] < 0.0)))
    return wp.where(flip, -axis, axis)


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
