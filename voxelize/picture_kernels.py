# mypy: ignore-errors
"""Warp kernel: parallel light and parallel view through a cube of bricks, added to a picture front to back.

Fibers shine by Kajiya and Kay 1989: diffuse light goes with the sine of the angle between fiber and light.
"""

from __future__ import annotations

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.struct
class View:
    """An orthographic view along one axis, from its upper end."""

    axis: wp.int32
    """0, 1, 2: looked along; the picture's u and v are the next two axes, cyclically."""
    stride: wp.int32
    """Voxels along a pixel's edge."""
    light: wp.vec3
    """Unit vector toward the light."""
    depth_per_density: wp.float32
    """Optical depth of one voxel of volume fraction 1, across the fiber."""


@wp.func
def layer_of_pixel(
    view: View,
    side: int,
    rows: wp.array(dtype=wp.int32),
    density: wp.array2d(dtype=wp.float32),
    direction: wp.array2d(dtype=wp.vec3),
    corner: wp.vec3i,
):
    """Optical depth of the voxels of one pixel in one layer, and the same times the light they send back."""
    depth = wp.float32(0.0)
    shade = wp.float32(0.0)
    for n in range(view.stride * view.stride):
        at = corner
        at[(view.axis + 1) % 3] += n // view.stride
        at[(view.axis + 2) % 3] += n % view.stride
        row = rows[((at[0] >> 3) * side + (at[1] >> 3)) * side + (at[2] >> 3)]
        if row >= 0:
            voxel = ((at[0] & 7) << 6) | ((at[1] & 7) << 3) | (at[2] & 7)
            amount = density[row, voxel]
            if amount > 0.0:
                t = direction[row, voxel]
                along = t[view.axis]
                cosine = wp.dot(t, view.light)
                own = amount * view.depth_per_density * wp.sqrt(wp.max(1.0 - along * along, 0.0))
                depth += own
                shade += own * wp.sqrt(wp.max(1.0 - cosine * cosine, 0.0))
    samples = float(view.stride * view.stride)
    return depth / samples, shade / samples


@wp.kernel
def add_cube(
    view: View,
    side: int,
    rows: wp.array(dtype=wp.int32),
    density: wp.array2d(dtype=wp.float32),
    direction: wp.array2d(dtype=wp.vec3),
    first_pixel: wp.vec2i,
    first_depth: int,
    transmittance: wp.array2d(dtype=wp.float32),
    light: wp.array2d(dtype=wp.float32),
    height: wp.array2d(dtype=wp.float32),
):
    """One thread per pixel; cubes must come front to back. `rows` [side^3]: the brick in each place, or -1.

    `light` receives what reaches the viewer, `height` the same with the voxel's coordinate in place of light.
    """
    i, j = wp.tid()
    x = first_pixel[0] + i
    y = first_pixel[1] + j
    through = transmittance[x, y]
    shone = light[x, y]
    high = height[x, y]
    for back in range(side * 8):
        w = side * 8 - 1 - back
        corner = wp.vec3i(0, 0, 0)
        corner[view.axis] = w
        corner[(view.axis + 1) % 3] = i * view.stride
        corner[(view.axis + 2) % 3] = j * view.stride
        depth, shade = layer_of_pixel(view, side, rows, density, direction, corner)
        if depth > 0.0:
            stopped = through * (1.0 - wp.exp(-depth))
            shone += stopped * shade / depth
            high += stopped * float(first_depth + w)
            through -= stopped
    transmittance[x, y] = through
    light[x, y] = shone
    height[x, y] = high
