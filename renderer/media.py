"""Media that are no fibers of the volume: homogeneous ones within bounds, and further grids, by color."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from weft.files.errors import DeviceMemoryError, InputError
from weft.voxelize.grid import BRICK_SIZE, BRICK_VOXELS, FiberGrid, FiberVolume

from .brick_file import BrickFile
from .brick_pool import EMPTY_CELL, MAX_CELLS, BrickPool, empty_radius
from .config import RenderConfig
from .gpu.shader_source import Constant
from .media_config import BallBound, GridMedium, HomogeneousMedium, Medium, MeshBound
from .simple_phases import SimplePhase
from .stencil import closed_mesh_corners, inside_of_voxels

MOST_GRID_MEDIA = 64
MOST_HOMOGENEOUS = 8
"""Uniforms of each; OpenGL 4.3 promises room for 256 rows."""


@dataclass(frozen=True)
class OtherMedia:
    """All of them, behind the media of the volume: those on the grid, then the homogeneous ones."""

    fiber_count: int
    """Media of the volume itself."""
    gridded: tuple[GridMedium | HomogeneousMedium, ...]
    """One for each grid that was added; homogeneous ones within meshes are among them."""
    homogeneous: tuple[HomogeneousMedium, ...]
    content_sha256: str
    """Of the grids that were added."""

    @property
    def phases(self) -> list[SimplePhase]:
        return [medium.scattering.to_phase() for medium in (*self.gridded, *self.homogeneous)]

    @property
    def colored(self) -> bool:
        """Whether extinction depends on color anywhere."""
        every = (*self.gridded, *self.homogeneous)
        return any(len(set(medium.extinction_per_mm)) > 1 for medium in every)

    def extinction_scale(self, fibers: np.ndarray, voxel_size_mm: float) -> np.ndarray:
        """Extinction of density 1 per medium on the grid [1/voxel]; `fibers`: as if all were fibers."""
        added = [max(medium.extinction_per_mm) * voxel_size_mm for medium in self.gridded]
        return np.concatenate([fibers[: self.fiber_count], added])

    def constants(self) -> dict[str, Constant]:
        return {
            "GRID_MEDIA": self.fiber_count + len(self.gridded),
            "HOMOGENEOUS_MEDIA": len(self.homogeneous),
        }

    def uniforms(self, pool: BrickPool) -> dict[str, object]:
        """Lengths in voxels, from the pool's corner."""
        tints: list[tuple[float, ...]] = [(1.0, 1.0, 1.0, 0.0)] * self.fiber_count
        for medium in self.gridded:
            peak = max(medium.extinction_per_mm) or 1.0
            tints.append((*(value / peak for value in medium.extinction_per_mm), 1.0))
        values: dict[str, object] = {"grid_tints": _array(tints)}
        if self.homogeneous:
            rows = [_bound_rows(medium, pool) for medium in self.homogeneous]
            names = ("bound_lower", "bound_upper", "bound_extinction")
            values |= {name: _array([row[i] for row in rows]) for i, name in enumerate(names)}
        return values


def _array(rows: list[tuple[float, ...]]) -> object:
    """moderngl takes an array of one as the one."""
    return rows if len(rows) > 1 else rows[0]


def _bound_rows(medium: HomogeneousMedium, pool: BrickPool) -> list[tuple[float, ...]]:
    """As shaders/medium/media.glsl reads them."""
    size, bound = pool.voxel_size_mm, medium.bound
    extinction = (*(value * size for value in medium.extinction_per_mm), 0.0)
    if isinstance(bound, BallBound):
        middle = (np.array(bound.position_mm) - pool.corner_mm) / size
        return [(*middle.tolist(), 1.0), (bound.radius_mm / size, 0.0, 0.0, 0.0), extinction]
    assert not isinstance(bound, MeshBound)
    low, high = (bound.bounds_mm - pool.corner_mm) / size
    return [(*low.tolist(), 0.0), (*high.tolist(), 0.0), extinction]


def with_other_media(
    config: RenderConfig, volume: FiberVolume | BrickFile
) -> tuple[FiberVolume | BrickFile, OtherMedia | None]:
    """The volume with the grids of `config.media` added, and what is known of them; none: None."""
    if not config.media:
        return volume, None
    homogeneous = tuple(
        one
        for one in config.media
        if isinstance(one, HomogeneousMedium) and not isinstance(one.bound, MeshBound)
    )
    sources = [one for one in config.media if one not in homogeneous]
    if sources and isinstance(volume, BrickFile):
        what = 'render.media: kind = "grid" and meshes as bounds must be in memory.'
        raise InputError(what, hint="Leave out brick_pool_mb.")
    size = 0.0 if isinstance(volume, BrickFile) else volume.voxel_size_mm
    grids = [(one, grid) for one in sources for grid in _grids_of(one, size)]
    count = len(volume.media)
    _refuse_too_many(count + len(grids), len(homogeneous))
    volume, digest = _superposed(volume, [grid for _, grid in grids])
    return volume, OtherMedia(count, tuple(one for one, _ in grids), homogeneous, digest)


def _refuse_too_many(on_grid: int, homogeneous: int) -> None:
    for count, most, what in (
        (on_grid, MOST_GRID_MEDIA, "media on the grid"),
        (homogeneous, MOST_HOMOGENEOUS, "homogeneous media in boxes and balls"),
    ):
        if count > most:
            raise InputError(f"render.media: {count} {what}; the renderer takes {most}.")


def _superposed(
    volume: FiberVolume | BrickFile, added: Sequence[FiberGrid]
) -> tuple[FiberVolume | BrickFile, str]:
    if not added:
        return volume, ""
    assert isinstance(volume, FiberVolume)
    extra = {f"media {i}": grid for i, grid in enumerate(added)}
    digest = FiberVolume(extra).content_sha256
    return replace(volume, grids={**volume.grids, **extra}, report=None), digest


def _grids_of(medium: Medium, voxel_size_mm: float) -> list[FiberGrid]:
    if isinstance(medium, GridMedium):
        from weft.voxelize.vdb import read_volume

        grids = list(read_volume(medium.file).grids.values())
        if abs(grids[0].voxel_size_mm / voxel_size_mm - 1) > 1e-9:
            what = f"has voxels of {grids[0].voxel_size_mm:g} mm; the volume's are {voxel_size_mm:g} mm"
            raise InputError(what, path=medium.file, hint="All media of a picture share one size.")
        return grids
    assert isinstance(medium.bound, MeshBound)
    return [_filled_mesh(medium.bound, voxel_size_mm)]


def _filled_mesh(bound: MeshBound, voxel_size_mm: float) -> FiberGrid:
    """Density 1 in every voxel whose middle lies inside."""
    corners = closed_mesh_corners(bound, "the bound of a medium") / voxel_size_mm
    low = np.floor(corners.min(axis=(0, 1)) / BRICK_SIZE).astype(np.int64)
    count = np.ceil(corners.max(axis=(0, 1)) / BRICK_SIZE).astype(np.int64) - low
    if np.prod(count.astype(float)) > MAX_CELLS / BRICK_VOXELS:
        raise DeviceMemoryError(
            f"render.media: the mesh {bound.file.name} spans {count.tolist()} bricks of voxels.",
            hint="Raise voxelize.voxel_size_mm, or bound the medium by a box or a ball.",
        )
    places = np.stack(np.meshgrid(*[np.arange(n) for n in count], indexing="ij"), -1).reshape(-1, 3)
    origins = ((places + low) * BRICK_SIZE).astype(np.int32)
    inside = inside_of_voxels(origins, corners)
    kept = inside.any(axis=1)
    if not kept.any():
        what = "no voxel lies inside of the mesh that bounds a medium."
        raise InputError(what, path=bound.file, hint="Check unit_mm and placement.")
    direction = np.where(inside[kept][..., None], np.array([0, 1, 0], np.float32), np.float32(0))
    density = inside[kept].astype(np.float32)
    return FiberGrid(voxel_size_mm, voxel_size_mm, origins[kept], density, direction)


def pool_around(pool: BrickPool, media: OtherMedia) -> BrickPool:
    """With empty cells as far as the bounds of the homogeneous media reach."""
    boxes = [one.bound.bounds_mm for one in media.homogeneous if not isinstance(one.bound, MeshBound)]
    if not boxes:
        return pool
    step = BRICK_SIZE * pool.voxel_size_mm
    corners = np.concatenate(boxes)
    low, high = np.floor(corners.min(axis=0) / step), np.ceil(corners.max(axis=0) / step)
    first = pool.origin // BRICK_SIZE
    low = np.minimum(low, first).astype(np.int64)
    high = np.maximum(high, first + pool.cells.shape).astype(np.int64)
    shape = tuple(int(n) for n in high - low)
    if np.prod(shape, dtype=float) > MAX_CELLS:
        raise DeviceMemoryError(
            f"render.media: with its homogeneous media the volume spans {shape} bricks, "
            f"more than the renderer's {MAX_CELLS}.",
            hint="Raise voxelize.voxel_size_mm, or make their bounds smaller.",
        )
    words = np.full(shape, EMPTY_CELL, np.uint32)
    inner = tuple(slice(a, a + n) for a, n in zip(first - low, pool.cells.shape, strict=True))
    words[inner] = pool.cells
    empty = words >= EMPTY_CELL
    words[empty] = EMPTY_CELL | empty_radius(~empty)[empty]
    return replace(pool, origin=low * BRICK_SIZE, cells=words)
