"""Whether a voxelization fits in memory, known before it begins."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import NoReturn

import numpy as np

from weft.files.errors import InputError
from weft.files.machine_memory import available_memory_bytes

from .grid import BRICK_SIZE, BRICK_VOXELS
from .tile_sums import SUM_BYTES
from .tiles import VoxelBox, cells_touched, clip_boxes, voxel_boxes

BRICK_BYTES = BRICK_VOXELS * (4 + 12) + 12
"""Density, direction and origin of one brick."""

INDEX_BYTES = 320
"""What stays in memory of a brick whose values are on the disk: place, mask, digest, offsets, a leaf."""

WORKING_BYTES = BRICK_VOXELS * (SUM_BYTES + 3 * 16)
"""Of a brick while its tile is being filled: sums, and its values thrice, as made, packed and hashed."""

ALBEDO_BYTES = BRICK_VOXELS * (32 + 3 * 12 + 24)
"""What its colors take besides: sums, values thrice, and one copy in float64."""

SMALLEST_TILE = 16
"""Voxels along the edge; smaller tiles would make every strand tens of times."""

COPIES = 2.3
"""How often the bricks are held at the worst moment: here, and as a tree while a file is written."""

MAX_CELL_PAIRS = 2_000_000
"""Pairs of box and cell looked at in the estimate; larger cells are taken until there are fewer."""


def estimate_brick_count(bounds_mm: np.ndarray, *, voxel_size_mm: float, region: VoxelBox) -> float:
    """An upper bound of the bricks that fibers in the boxes [n, 2, 3] touch: the bricks in their union."""
    _, low, high = clip_boxes(*voxel_boxes(bounds_mm, voxel_size_mm), region)
    if not len(low):
        return 0.0
    cell = BRICK_SIZE
    while ((high - low) / cell + 1.0).prod(axis=1).sum() > MAX_CELL_PAIRS:
        cell *= 2
        if cell > (high - low).max():
            break
    _, cells = cells_touched(low, high, cell)
    extent = (cells.max(axis=0) - cells.min(axis=0) + 1).astype(np.int64)
    keys = ((cells - cells.min(axis=0)) @ np.array([extent[1] * extent[2], extent[2], 1])).astype(np.int64)
    return float(len(np.unique(keys))) * (cell / BRICK_SIZE) ** 3


def resident_bytes() -> int:
    """Memory that this process holds now."""
    try:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, IndexError, ValueError):
        return 0


def memory_budget(memory_mb: float | None) -> int:
    """Bytes that may still be taken: what is free, and within `memory_mb` for the whole process."""
    available = available_memory_bytes()
    return available if memory_mb is None else min(available, int(memory_mb * 2**20) - resident_bytes())


def tile_bytes(tile_voxels: int, *, albedo: bool = False) -> int:
    """What one worker holds for a tile whose bricks are all occupied."""
    return (tile_voxels // BRICK_SIZE) ** 3 * (WORKING_BYTES + albedo * ALBEDO_BYTES)


def fit_tiles(
    brick_count: float,
    *,
    voxel_size_mm: float,
    tile_voxels: int,
    workers: int,
    memory_mb: float | None,
    albedo: bool = False,
) -> tuple[int, int]:
    """Size of tiles and number of workers that keep a streamed voxelization of so many bricks within memory.

    Fewer workers are taken before smaller tiles. Raises `InputError` where nothing fits.
    """
    budget = memory_budget(memory_mb)
    room = budget - brick_count * INDEX_BYTES
    tile = tile_voxels
    while tile > SMALLEST_TILE and tile_bytes(tile, albedo=albedo) > room:
        tile = max(tile // 2 // BRICK_SIZE * BRICK_SIZE, SMALLEST_TILE)
    if tile_bytes(tile, albedo=albedo) > room:
        held = resident_bytes()
        needed = brick_count * INDEX_BYTES + tile_bytes(tile, albedo=albedo) + held
        _refuse(needed, budget + held, held + tile_bytes(tile, albedo=albedo), voxel_size_mm, memory_mb)
    return tile, int(max(1, min(workers, room // tile_bytes(tile, albedo=albedo))))


def refuse_what_does_not_fit(
    brick_count: float, *, fixed_bytes: float, voxel_size_mm: float, memory_mb: float | None
) -> None:
    """Raise `InputError` when the bricks, with their copies, and the tiles in work need too much."""
    available = available_memory_bytes()
    if memory_mb is not None:
        available = min(available, int(memory_mb * 2**20))
    needed = fixed_bytes + COPIES * brick_count * BRICK_BYTES
    if needed > available:
        _refuse(needed, available, fixed_bytes, voxel_size_mm, memory_mb)


def _refuse(
    needed: float, available: float, fixed_bytes: float, voxel_size_mm: float, memory_mb: float | None
) -> NoReturn:
    """Name the voxel size at which what is not fixed would fit."""
    room = max(available - fixed_bytes, 0.05 * available)
    # a tenth more than the inverse cube says, since coarser bricks also reach farther beyond the fibers
    coarser = 1.1 * voxel_size_mm * max((needed - fixed_bytes) / room, 1.0) ** (1 / 3)
    raise InputError(
        f"voxelize: voxels of {voxel_size_mm:g} mm may need {_gibibytes(needed)} "
        f"but {_gibibytes(available)} are available; "
        f"set voxelize.voxel_size_mm to {_round_up(coarser):g} or more, or a smaller voxelize.region_mm"
        + (", or raise voxelize.memory_mb." if memory_mb is not None else ".")
    )


def _gibibytes(count: float) -> str:
    return f"{count / 2**30:.3g} GiB" if count < 1e15 else f"{count / 2**30:.0e} GiB"


def _round_up(value: float) -> float:
    """Up to two significant digits."""
    scale = 10.0 ** (math.floor(math.log10(value)) - 1)
    return math.ceil(value / scale) * scale
