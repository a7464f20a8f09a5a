"""A volume at several voxel sizes, as `voxelize.levels` writes them."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace

import numpy as np

from weft.files.errors import InputError
from weft.voxelize.grid import FiberVolume

from .brick_file import BrickFile
from .brick_pool import BrickPool, LevelShare, build_brick_pool
from .detail import PixelFootprint, choose_bricks
from .mixed_pool import level_bricks, mixed_pool


@dataclass(frozen=True)
class VolumeLevels:
    """One volume, finest first, each with voxels twice as large as the one before."""

    levels: tuple[FiberVolume | BrickFile, ...]
    extinction_error_rms: tuple[float | None, ...] = ()
    """Of each level against the finest, relative, as voxelize measured it."""

    def __post_init__(self) -> None:
        size = voxel_size_mm(self.levels[0])
        for number, level in enumerate(self.levels):
            if not np.isclose(voxel_size_mm(level), size * 2**number, rtol=1e-9):
                raise InputError(
                    f"render: level {number} has voxels of {voxel_size_mm(level):g} mm; "
                    f"{size * 2**number:g} mm are right."
                )

    @property
    def media(self) -> tuple[str, ...]:
        """Of all levels; coarser ones may have second lobes of them besides."""
        return tuple(dict.fromkeys(name for level in self.levels for name in level.media))

    @property
    def bounds_mm(self) -> np.ndarray:
        """Corners of the box around the finest bricks [mm], float64, shape [2, 3]."""
        return np.asarray(self.levels[0].bounds_mm)

    @property
    def content_sha256(self) -> str:
        hashes = "\n".join(level.content_sha256 for level in self.levels)
        return hashlib.sha256(hashes.encode()).hexdigest()

    def pool(self, footprint: PixelFootprint, pixels: float, *, on_disk: bool = False) -> BrickPool:
        """Every brick at the coarsest level whose voxels appear no larger than `pixels`.

        Where all are of the finest level this is `build_brick_pool` of it. `on_disk`: voxels that lie there
        stay there.
        """
        size = voxel_size_mm(self.levels[0])
        bricks = [level_bricks(level, self.media) for level in self.levels]
        chosen = choose_bricks([b.places for b in bricks], size, footprint, pixels)
        if not any(rows.any() for rows in chosen[1:]):
            return replace(finest_pool(self.levels[0]), detail=(self._share(0, size, chosen[0], 1.0),))
        coarsest = max(number for number, rows in enumerate(chosen) if rows.any())
        pool, shares = mixed_pool(bricks[: coarsest + 1], chosen, size, on_disk=on_disk)
        found = zip(range(coarsest + 1), chosen, shares.tolist(), strict=False)
        return replace(pool, detail=tuple(self._share(n, size, rows, share) for n, rows, share in found))

    def _share(self, number: int, size: float, chosen: np.ndarray, share: float) -> LevelShare:
        errors = self.extinction_error_rms
        error = 0.0 if number == 0 else errors[number] if number < len(errors) else None
        return LevelShare(number, size * 2**number, int(chosen.sum()), share, error)


def voxel_size_mm(volume: FiberVolume | BrickFile) -> float:
    """Edge of a voxel."""
    if isinstance(volume, BrickFile):
        return float(volume.header["voxel_size_mm"])
    return volume.voxel_size_mm


def finest_pool(volume: FiberVolume | BrickFile) -> BrickPool:
    """The bricks of one level alone."""
    return volume.pool() if isinstance(volume, BrickFile) else build_brick_pool(list(volume.grids.values()))
