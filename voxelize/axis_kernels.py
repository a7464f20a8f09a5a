# mypy: ignore-errors
"""Warp functions: the direction of a voxel's fibers, the axis of their second moment. Smith 1961.

Twin: tile_extension/, in C++ for the CPU.
"""

from __future__ import annotations

import warp as wp

THIRD_OF_ANGLE = (
    0.7660444431189773, 0.24740906632284596, -0.01550918843636095, 0.0024663528154554026,
    -0.0005041246941713294, 0.00011642544735162777, -2.8919908083649873e-05, 7.541116258522758e-06,
    -2.0359982138012955e-06, 5.64018149027463e-07, -1.592248868463443e-07, 4.612243144631487e-08,
    -1.3792790111301991e-08, 3.642254207918733e-09, -8.450712135305638e-10, 5.15250520454934e-10,
    -2.1940729610579496e-10,
)  # fmt: skip
"""cos(2/3 acos((z + 1) / 2)) as a polynomial of z in [-1, 1], to 1.2e-14: Chebyshev interpolation. Sums and
products alone, so that every compiler and processor gives the same bits."""

# as constants: within a kernel 1.0 / 3.0 is a number of 32 bits
_THIRD = wp.constant(wp.float64(1.0 / 3.0))
_SIXTH = wp.constant(wp.float64(1.0 / 6.0))
_THIRD_OF_ANGLE = wp.constant(wp.types.vector(17, wp.float64)(*THIRD_OF_ANGLE))


@wp.func
def unit(v: wp.vec3d):
    """v / |v|, as the C++ twin computes it."""
    return v * (wp.float64(1.0) / wp.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]))


@wp.func
def squared(v: wp.vec3d):
    return v[0] * v[0] + v[1] * v[1] + v[2] * v[2]


@wp.func
def axis_in_plane(diagonal: wp.vec3d, off: wp.vec3d, value: wp.float64):
    """The axis of two equal largest eigenvalues: any in their plane; this is the one nearest the coordinate
    axis of the largest diagonal element. The rows of A - value I are normal to the plane.
    """
    normal = wp.vec3d(diagonal[0] - value, off[0], off[1])
    row_y = wp.vec3d(off[0], diagonal[1] - value, off[2])
    row_z = wp.vec3d(off[1], off[2], diagonal[2] - value)
    if squared(row_y) > squared(normal):
        normal = row_y
    if squared(row_z) > squared(normal):
        normal = row_z
    n = unit(normal)
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    axis = wp.vec3d(one, zero, zero)
    along = n[0]
    if diagonal[1] > diagonal[0] and diagonal[1] >= diagonal[2]:
        axis = wp.vec3d(zero, one, zero)
        along = n[1]
    elif diagonal[2] > diagonal[0]:
        axis = wp.vec3d(zero, zero, one)
        along = n[2]
    return unit(wp.vec3d(axis[0] - n[0] * along, axis[1] - n[1] * along, axis[2] - n[2] * along))


@wp.func
def cosine_of_third(cosine: wp.float64):
    """cos(acos(cosine) / 3)."""
    z = wp.float64(2.0) * wp.sqrt(wp.float64(0.5) * (wp.float64(1.0) + cosine)) - wp.float64(1.0)
    total = _THIRD_OF_ANGLE[16]
    for k in range(1, 17):
        total = total * z + _THIRD_OF_ANGLE[16 - k]
    return total


@wp.func
def largest_eigenvector(diagonal: wp.vec3d, off: wp.vec3d):
    """Unit eigenvector of the largest eigenvalue of a symmetric 3 x 3 matrix; off = (xy, xz, yz).

    Closed form: Smith 1961 for the eigenvalue, then the longest cross product of two rows of A - lambda I.
    """
    mean = (diagonal[0] + diagonal[1] + diagonal[2]) * _THIRD
    x = diagonal[0] - mean
    y = diagonal[1] - mean
    z = diagonal[2] - mean
    xy = off[0]
    xz = off[1]
    yz = off[2]
    two = wp.float64(2.0)
    spread = wp.sqrt((x * x + y * y + z * z + two * squared(off)) * _SIXTH)
    if spread < wp.float64(1.0e-12):
        return wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
    determinant = x * (y * z - yz * yz) - xy * (xy * z - yz * xz) + xz * (xy * yz - y * xz)
    inverse = wp.float64(1.0) / spread
    cosine = wp.float64(0.5) * determinant * inverse * inverse * inverse
    shift = two * spread * cosine_of_third(wp.clamp(cosine, wp.float64(-1.0), wp.float64(1.0)))
    rx = x - shift
    ry = y - shift
    rz = z - shift
    best = wp.vec3d(xy * yz - xz * ry, xz * xy - rx * yz, rx * ry - xy * xy)
    second = wp.vec3d(xy * rz - xz * yz, xz * xz - rx * rz, rx * yz - xy * xz)
    third = wp.vec3d(ry * rz - yz * yz, yz * xz - xy * rz, xy * yz - ry * xz)
    if squared(second) > squared(best):
        best = second
    if squared(third) > squared(best):
        best = third
    if squared(best) > wp.float64(1.0e-24) * spread * spread * spread * spread:
        return unit(best)
    return axis_in_plane(diagonal, off, mean + shift)


@wp.func
def hemisphere(axis: wp.vec3):
    """The one of axis and -axis whose last nonzero component is positive."""
    flip = axis[2] < 0.0 or (axis[2] == 0.0 and (axis[1] < 0.0 or (axis[1] == 0.0 and axis[0] < 0.0)))
    return wp.where(flip, -axis, axis)
