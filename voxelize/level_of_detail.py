"""Coarser volumes from finer ones, with one or two directions a voxel.

Fiber length is conserved, and so are the second moment and the dye where the finer volume has them: the dye
of a lobe is its voxels' mean, weighted by density. One mean direction makes of warp and weft in a voxel
something between; two lobes keep them apart. The second lobe is a medium of its own on the same voxels,
`<medium>_crossing`, so that whoever draws overlapping media draws both. The work is done in cubes of whole
coarse bricks, so that a volume on the disk need not fit in memory.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import warp as wp

from . import level_kernels
from .accumulator import BrickBatch
from .grid import BRICK_SIZE, BRICK_VOXELS, CHANNELS, OPTIONAL, FiberGrid, FiberVolume
from .grid_files import SECOND_LOBE
from .tile_sums import DEVICE

BLOCK_BRICKS = 16
"""Finer bricks along the edge of a cube that is coarsened at a time."""
VIEW_COUNT = 12
"""Directions in which the error of the extinction is measured."""
WIDTH = {name: wp.vec3 if width == 3 else wp.float32 for name, width in CHANNELS.items()}

Read = Callable[[np.ndarray], Mapping[str, np.ndarray]]
"""The channels of some bricks of a grid, by their rows."""


class _HasBricks(Protocol):
    @property
    def origins(self) -> np.ndarray: ...
    @property
    def channels(self) -> Any: ...


@dataclass(frozen=True)
class ExtinctionError:
    """Of a coarse level against the finest, over voxels and directions, weighted by extinction."""

    mean: float
    """Of coarse / fine - 1."""
    rms: float
    """Root mean square of coarse / fine - 1."""


@dataclass(frozen=True)
class CoarseBlock:
    """The coarse bricks of one cube, per lobe, and what their errors add up to."""

    lobes: list[BrickBatch]
    error_sums: np.ndarray
    """Extinction, its error, and the error squared over the extinction, float64, shape [3]."""


def coarsen(volume: FiberVolume, *, lobes: int = 2, factor: int = 2) -> FiberVolume:
    """The volume on voxels `factor` times as large, a power of two, with one direction in each or two."""
    if lobes not in (1, 2):
        raise ValueError(f"a voxel has one lobe or two, not {lobes}")
    grids: dict[str, FiberGrid] = {}
    for name, grid in volume.grids.items():
        side = max(BLOCK_BRICKS, factor)
        blocks = [
            coarsen_block(grid, rows, _reader(grid), side=side, factor=factor, lobes=lobes)
            for rows in blocks_of(grid.origins, side)
        ]
        for lobe, lobe_name in enumerate((name, name + SECOND_LOBE)[:lobes]):
            grids[lobe_name] = _join(grid, [block.lobes[lobe] for block in blocks], factor)
    return FiberVolume(grids)


def _reader(grid: FiberGrid) -> Read:
    return lambda rows: {name: array[rows] for name, array in grid.channels.items()}


def _join(fine: FiberGrid, batches: list[BrickBatch], factor: int) -> FiberGrid:
    names = list(fine.channels)
    origins = np.concatenate([np.empty((0, 3), np.int32), *(batch.origins for batch in batches)])
    order = np.lexsort((origins[:, 2], origins[:, 1], origins[:, 0]))
    arrays = {
        name: np.concatenate([_zeros(0, name), *(batch.channels[name] for batch in batches)])[order]
        for name in names
    }
    return FiberGrid(
        voxel_size_mm=factor * fine.voxel_size_mm,
        fiber_radius_mm=fine.fiber_radius_mm,
        origins=np.ascontiguousarray(origins[order]),
        **arrays,
    )


def blocks_of(origins: np.ndarray, side: int) -> Iterator[np.ndarray]:
    """Rows of the bricks in each cube of `side` bricks along an edge, cubes sorted by (x, y, z)."""
    cube = origins // (BRICK_SIZE * side)
    order = np.lexsort((cube[:, 2], cube[:, 1], cube[:, 0]))
    ends = np.flatnonzero((np.diff(cube[order], axis=0) != 0).any(axis=1)) + 1
    yield from (rows for rows in np.split(order, ends) if len(rows))


def coarsen_in_order(
    jobs: Sequence[tuple[Any, ...]], work: Callable[..., Any], workers: int
) -> Iterator[Any]:
    """`work(*job)` for each job, side by side, a few at a time, in order. Warp lets go of the interpreter."""
    wp.load_module(level_kernels, device=DEVICE)
    with ThreadPoolExecutor(workers) as pool:
        for begin in range(0, len(jobs), 4 * workers):
            yield from pool.map(lambda job: work(*job), jobs[begin : begin + 4 * workers])


def coarsen_block(
    grid: _HasBricks, rows: np.ndarray, read: Read, *, side: int, factor: int, lobes: int
) -> CoarseBlock:
    """The bricks in one cube of `side` bricks along an edge, as voxels `factor` times as large."""
    return coarsen_values(grid.origins[rows], read(rows), side=side, factor=factor, lobes=lobes)


def coarsen_values(
    origins: np.ndarray, values: Mapping[str, np.ndarray], *, side: int, factor: int, lobes: int
) -> CoarseBlock:
    """`coarsen_block` of bricks that have been read."""
    corner = origins[0] // (BRICK_SIZE * side) * side
    place = origins // BRICK_SIZE - corner
    coarse = np.unique(place // factor, axis=0).astype(np.int32)
    names = list(values)
    results = {name: _lobe_zeros(lobes, len(coarse), name) for name in names}
    empty = {name: _lobe_zeros(lobes, 0, name) for name in OPTIONAL if name not in names}
    errors = np.zeros((len(coarse), BRICK_VOXELS, 3))
    wp.launch(
        level_kernels.coarsen_bricks,
        dim=(len(coarse), BRICK_VOXELS),
        inputs=[_fine_block(place, values, side), factor, lobes, _shared(coarse, wp.vec3i), _views()],
        outputs=[
            *(_shared((results | empty)[name], WIDTH[name]) for name in CHANNELS),
            _shared(errors, wp.vec3d),
        ],
        device=DEVICE,
    )
    first = ((corner // factor + coarse) * BRICK_SIZE).astype(np.int32)
    batches = []
    for lobe in range(lobes):
        held = results["density"][lobe].any(axis=1)
        batches.append(BrickBatch(first[held], **{name: results[name][lobe][held] for name in names}))
    return CoarseBlock(batches, errors.sum(axis=(0, 1)))


def extinction_error(sums: np.ndarray) -> ExtinctionError:
    """From the sums of all blocks, shape [3]."""
    truth = max(float(sums[0]), 1e-300)
    return ExtinctionError(float(sums[1]) / truth, math.sqrt(float(sums[2]) / truth))


def _fine_block(place: np.ndarray, values: Mapping[str, np.ndarray], side: int) -> level_kernels.FineBlock:
    rows = np.full(side**3, -1, dtype=np.int32)
    rows[np.ravel_multi_index(tuple(place.T), (side, side, side))] = np.arange(len(place))
    block = level_kernels.FineBlock()
    block.bricks_per_side = side
    block.rows = _shared(rows, wp.int32)
    block.density = _shared(np.ascontiguousarray(values["density"]), wp.float32)
    block.direction = _shared(np.ascontiguousarray(values["direction"]), wp.vec3)
    for name in OPTIONAL:
        array = values.get(name, _zeros(0, name))
        setattr(block, name, _shared(np.ascontiguousarray(array), wp.vec3))
    return block


def _views() -> wp.array:
    """Unit vectors spread evenly over the hemisphere z > 0 (Fibonacci), float32, shape [VIEW_COUNT, 3]."""
    z = (np.arange(VIEW_COUNT) + 0.5) / VIEW_COUNT
    angle = np.arange(VIEW_COUNT) * math.pi * (3 - math.sqrt(5))
    radius = np.sqrt(1 - z * z)
    views = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
    return wp.array(views.astype(np.float32), dtype=wp.vec3, device=DEVICE)


def _zeros(count: int, channel: str) -> np.ndarray:
    return _lobe_zeros(1, count, channel)[0]


def _lobe_zeros(lobes: int, count: int, channel: str) -> np.ndarray:
    width = CHANNELS[channel]
    return np.zeros((lobes, count, BRICK_VOXELS) + ((width,) if width > 1 else ()), dtype=np.float32)


def _shared(array: np.ndarray, dtype: type) -> wp.array:
    return wp.array(array, dtype=dtype, device=DEVICE, copy=False)
