"""Bricks of voxels as buffers of the device: how many buffers there are, and how the shader finds a voxel."""

from __future__ import annotations

from collections.abc import Mapping

import moderngl
import numpy as np

from .brick_pool import BrickPool
from .gpu.device_memory import named_block_bytes

MAX_VOXEL_PAGES = 8
FIRST_PAGE_BINDING = 7
STORAGE_BLOCKS = 8
"""Storage buffers of a compute program that OpenGL 4.3 guarantees."""


def brick_records(pool: BrickPool, extinction_scale: np.ndarray) -> np.ndarray:
    """Per brick: extinction of a level [1/voxel] as bits, medium | largest level << 16; uint32 [n, 2].

    `extinction_scale`: extinction of volume fraction 1 per medium [1/voxel].
    """
    records = np.empty((len(pool.voxels), 2), np.uint32)
    per_level = pool.density_step * extinction_scale[pool.medium]
    records[:, 0] = per_level.astype(np.float32).view(np.uint32)
    records[:, 1] = pool.medium | pool.majorant_level << 16
    return records


def voxel_pages_glsl(
    page_count: int, page_shift: int, *, slot_table: int | None = None, brick_words: int = 512
) -> str:
    """Buffers of voxels and the function that picks the right one.

    `slot_table`: where in bricks[] the table begins that says in which slot of the pages a brick lies;
    without it, brick n lies in slot n. `brick_words`: of one brick, 512 for voxels and as many for colors.
    """
    lines = [
        f"layout(std430, binding = {binding}) readonly buffer Voxels{i} {{ uint voxels_{i}[]; }};"
        for i, binding in enumerate(range(FIRST_PAGE_BINDING, FIRST_PAGE_BINDING + page_count))
    ]
    slot = "brick"
    if slot_table is not None:
        slot = "brick_slot(brick)"
        lines += [
            "uint brick_slot(uint brick) {",
            f"    uvec2 pair = bricks[{slot_table}u + (brick >> 1u)];",
            "    return (brick & 1u) == 0u ? pair.x : pair.y;",
            "}",
        ]
    lines += ["uint voxel_word(uint brick, uint voxel) {", f"    uint slot = {slot};"]
    if page_count > 1:
        mask = (1 << page_shift) - 1
        lines += [
            f"    uint page = slot >> {page_shift}u;",
            f"    uint index = (slot & {mask}u) * {brick_words}u + voxel;",
        ]
        lines += [f"    if (page == {i}u) return voxels_{i}[index];" for i in range(page_count - 1)]
        lines += [f"    return voxels_{page_count - 1}[index];"]
    else:
        lines += [f"    return voxels_0[slot * {brick_words}u + voxel];"]
    return "\n".join([*lines, "}"]) + "\n"


def page_limit(limits: Mapping[str, int]) -> int:
    """Buffers of voxels that this driver has room for beside the other seven; OpenGL 4.3 guarantees one."""
    counted = ("GL_MAX_COMPUTE_SHADER_STORAGE_BLOCKS", "GL_MAX_SHADER_STORAGE_BUFFER_BINDINGS")
    blocks = min(limits.get(name) or STORAGE_BLOCKS for name in counted)
    return int(min(blocks - FIRST_PAGE_BINDING, MAX_VOXEL_PAGES))


def bricks_per_page(context: moderngl.Context, brick_bytes: int) -> int:
    """A power of two of bricks that fits one storage block of this driver, and 31-bit byte offsets."""
    bricks = min(named_block_bytes(context), 1 << 30) // brick_bytes
    return 1 << (bricks.bit_length() - 1)
