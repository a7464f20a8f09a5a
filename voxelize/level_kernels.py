# mypy: ignore-errors
"""Warp kernel: one coarse voxel from the finer ones in it, with one direction or two, and the error it makes.

The two lobes are two clusters of axes, found by 2-means as in Wu et al. 2016. Children are visited in a fixed
order, so the same bits come out whatever runs beside.
"""

from __future__ import annotations

import math

import warp as wp

from .axis_kernels import hemisphere, largest_eigenvector

ROUNDS = 4
"""Of sharing out the axes among two clusters."""
APART = 0.95
"""Two lobes whose axes have a larger cosine are one."""

wp.set_module_options({"enable_backward": False})

_ROUNDS = wp.constant(ROUNDS)
_APART = wp.constant(APART)
_NEAR = wp.constant(math.cos(0.5 * math.acos(APART)))
"""Axes that are all this near to their mean cannot fall into two lobes that are apart."""
_TINY = wp.constant(wp.float64(1.0e-12))


@wp.struct
class FineBlock:
    """Finer voxels of a cube of whole coarse bricks."""

    bricks_per_side: wp.int32
    rows: wp.array(dtype=wp.int32)
    """Row of each brick of the cube in the arrays below, flat [x, y, z]; -1 where there is none."""
    density: wp.array2d(dtype=wp.float32)
    direction: wp.array2d(dtype=wp.vec3)
    moment_diag: wp.array2d(dtype=wp.vec3)
    """Empty where the finer volume has no second moment; so is `moment_off`."""
    moment_off: wp.array2d(dtype=wp.vec3)
    albedo: wp.array2d(dtype=wp.vec3)
    """Likewise empty where the finer volume has no colors."""


@wp.struct
class Lobe:
    """What the children of one lobe add up to."""

    weight: wp.float64
    diagonal: wp.vec3d
    off: wp.vec3d


@wp.func
def child_at(block: FineBlock, corner: wp.vec3i, factor: int, child: int):
    """Row and voxel of the n-th child of a coarse voxel that begins at `corner`; row -1 where none is."""
    x = corner[0] + child // (factor * factor)
    y = corner[1] + (child // factor) % factor
    z = corner[2] + child % factor
    side = block.bricks_per_side
    row = block.rows[((x >> 3) * side + (y >> 3)) * side + (z >> 3)]
    return row, ((x & 7) << 6) | ((y & 7) << 3) | (z & 7)


@wp.func
def add_lobe(
    block: FineBlock,
    corner: wp.vec3i,
    factor: int,
    first: wp.vec3,
    second: wp.vec3,
    which: int,
    by_axis: int,
):  # fmt: skip
    """The sum over the children nearer to `first` (which = 0) or to `second` (1), of w and w t t^T.

    With `by_axis` t is the stored direction, else the stored second moment takes the place of t t^T.
    """
    lobe = Lobe()
    for child in range(factor * factor * factor):
        row, voxel = child_at(block, corner, factor, child)
        if row >= 0:
            w = wp.float64(block.density[row, voxel])
            if w > wp.float64(0.0):
                t = block.direction[row, voxel]
                nearer_second = wp.abs(wp.dot(second, t)) > wp.abs(wp.dot(first, t))
                if nearer_second == (which == 1):
                    diagonal = wp.vec3d(wp.vec3(t[0] * t[0], t[1] * t[1], t[2] * t[2]))
                    off = wp.vec3d(wp.vec3(t[0] * t[1], t[0] * t[2], t[1] * t[2]))
                    if by_axis == 0 and block.moment_diag.shape[0] > 0:
                        diagonal = wp.vec3d(block.moment_diag[row, voxel])
                        off = wp.vec3d(block.moment_off[row, voxel])
                    lobe.weight += w
                    lobe.diagonal += w * diagonal
                    lobe.off += w * off
    return lobe


@wp.func
def mean_color(
    block: FineBlock, corner: wp.vec3i, factor: int, first: wp.vec3, second: wp.vec3, which: int
):  # fmt: skip
    """The dye of the children of one lobe, as in `add_lobe`, weighted by density.

    The scattering coefficient of transmitted light is extinction times dye, and it is what adds up. Dye above
    1, which noise along the yarn may make, counts as 1, as it does when it is drawn.
    """
    weight = wp.float64(0.0)
    sum = wp.vec3d()
    for child in range(factor * factor * factor):
        row, voxel = child_at(block, corner, factor, child)
        if row >= 0:
            w = wp.float64(block.density[row, voxel])
            if w > wp.float64(0.0):
                t = block.direction[row, voxel]
                nearer_second = wp.abs(wp.dot(second, t)) > wp.abs(wp.dot(first, t))
                if nearer_second == (which == 1):
                    weight += w
                    color = block.albedo[row, voxel]
                    sum += w * wp.vec3d(wp.min(color, wp.vec3(1.0, 1.0, 1.0)))
    return wp.vec3(sum / weight)


@wp.func
def main_axis(lobe: Lobe):
    """Unit axis of the largest eigenvalue; zero for a lobe without children."""
    if not lobe.weight > wp.float64(0.0):
        return wp.vec3(0.0, 0.0, 0.0)
    unit = wp.float64(1.0) / lobe.weight
    return hemisphere(wp.vec3(largest_eigenvector(lobe.diagonal * unit, lobe.off * unit)))


@wp.func
def worst_served(block: FineBlock, corner: wp.vec3i, factor: int, axis: wp.vec3):
    """The direction that `axis` misses most, by weight; zero where all are near to it."""
    worst = wp.vec3(0.0, 0.0, 0.0)
    most = wp.float32(0.0)
    nearest = wp.float32(1.0)
    for child in range(factor * factor * factor):
        row, voxel = child_at(block, corner, factor, child)
        if row >= 0:
            w = block.density[row, voxel]
            if w > 0.0:
                t = block.direction[row, voxel]
                cosine = wp.abs(wp.dot(axis, t))
                nearest = wp.min(nearest, cosine)
                missed = w * (1.0 - cosine * cosine)
                if missed > most:
                    most = missed
                    worst = t
    if nearest > _NEAR:
        return wp.vec3(0.0, 0.0, 0.0)
    return worst


@wp.func
def two_axes(block: FineBlock, corner: wp.vec3i, factor: int, mean: wp.vec3):
    """Axes by which the children are told apart; the second is zero where one lobe serves all of them."""
    none = wp.vec3(0.0, 0.0, 0.0)
    first = mean
    second = worst_served(block, corner, factor, mean)
    split_first = first
    split_second = second
    if wp.length_sq(second) > 0.0:
        for _ in range(_ROUNDS):
            split_first = first
            split_second = second
            first = main_axis(add_lobe(block, corner, factor, split_first, split_second, 0, 1))
            second = main_axis(add_lobe(block, corner, factor, split_first, split_second, 1, 1))
        empty = wp.length_sq(first) == 0.0 or wp.length_sq(second) == 0.0
        if empty or wp.abs(wp.dot(first, second)) >= _APART:
            split_first = mean
            split_second = none
    return split_first, split_second


@wp.func
def across(axis: wp.vec3, w: wp.vec3):
    """Sine of the angle between two axes."""
    cosine = wp.dot(axis, w)
    return wp.float64(wp.sqrt(wp.max(1.0 - cosine * cosine, 0.0)))


@wp.kernel
def coarsen_bricks(
    block: FineBlock,
    factor: int,
    lobes: int,
    bricks: wp.array(dtype=wp.vec3i),
    views: wp.array(dtype=wp.vec3),
    density: wp.array3d(dtype=wp.float32),
    direction: wp.array3d(dtype=wp.vec3),
    moment_diag: wp.array3d(dtype=wp.vec3),
    moment_off: wp.array3d(dtype=wp.vec3),
    albedo: wp.array3d(dtype=wp.vec3),
    errors: wp.array2d(dtype=wp.vec3d),
):
    """Voxels of the coarse bricks at `bricks` (in coarse bricks, from the block's corner).

    Results have shape [lobe, brick, voxel]; moments and colors are written where their arrays are not
    empty. `errors` receives, over the directions `views`: extinction of the children, the lobes' less that,
    and its square over the former, all up to the factor 2 / (pi a).
    """
    row, voxel = wp.tid()
    at = bricks[row] * 8 + wp.vec3i(voxel >> 6, (voxel >> 3) & 7, voxel & 7)
    corner = at * factor
    none = wp.vec3(0.0, 0.0, 0.0)
    whole = add_lobe(block, corner, factor, none, none, 0, 1)
    if not whole.weight > wp.float64(0.0):
        return
    split_first = none
    split_second = none
    if lobes == 2:
        split_first, split_second = two_axes(block, corner, factor, main_axis(whole))
    children = wp.float64(factor * factor * factor)
    for lobe in range(lobes):
        sums = add_lobe(block, corner, factor, split_first, split_second, lobe, 0)
        if sums.weight > wp.float64(0.0):
            unit = wp.float64(1.0) / sums.weight
            density[lobe, row, voxel] = wp.float32(sums.weight / children)
            direction[lobe, row, voxel] = main_axis(sums)
            if moment_diag.shape[1] > 0:
                moment_diag[lobe, row, voxel] = wp.vec3(sums.diagonal * unit)
                moment_off[lobe, row, voxel] = wp.vec3(sums.off * unit)
            if albedo.shape[1] > 0:
                albedo[lobe, row, voxel] = mean_color(block, corner, factor, split_first, split_second, lobe)
    found = wp.vec3d()
    for view in range(views.shape[0]):
        w = views[view]
        truth = wp.float64(0.0)
        for child in range(factor * factor * factor):
            fine, place = child_at(block, corner, factor, child)
            if fine >= 0:
                amount = block.density[fine, place]
                if amount > 0.0:
                    truth += wp.float64(amount) * across(block.direction[fine, place], w)
        truth = truth / children
        made = wp.float64(0.0)
        for lobe in range(lobes):
            amount = density[lobe, row, voxel]
            if amount > 0.0:
                made += wp.float64(amount) * across(direction[lobe, row, voxel], w)
        missed = made - truth
        found += wp.vec3d(truth, missed, missed * missed / wp.max(truth, _TINY))
    errors[row, voxel] = found
