"""Settings of the voxel stage."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

Corner = tuple[float, float, float]


class ForeignVolumeConfig(BaseModel):
    """What a .vdb file of another program does not say of itself."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)

    fiber_radius_mm: float = Field(ge=1e-6, le=1e6)
    """Radius of the fibers that the density stands for."""
    density: str | None = None
    """Name of the float grid with the density. Default: "density", or the only one there is."""
    direction: str | None = None
    """Name of the vector grid with the fiber direction. Default: a usual name, or the only one there is."""
    density_scale: float = Field(default=1.0, gt=0, le=1e9)
    """What the file's density is multiplied by to become a volume fraction of fiber."""
    scale_to_mm: float = Field(default=1.0, gt=0, le=1e7)
    """Length of one unit of the file, in mm; 1000 where it was made in meters."""


class VoxelizeConfig(BaseModel):
    """Fibers to a sparse grid of density and direction."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)

    voxel_size_mm: float | None = Field(default=None, ge=1e-6, le=1000)
    """Edge of a voxel. Files and time grow as it shrinks."""
    voxels_per_fiber_diameter: float | None = Field(default=None, gt=0, le=100)
    """In place of voxel_size_mm: so many voxels across the thinnest fiber; 0.2 is five diameters a voxel."""
    voxels_per_pixel: float | None = Field(default=None, gt=0, le=100)
    """In place of voxel_size_mm: so many voxels across a pixel of [render], where the cloth is nearest to its
    camera (of several cameras, where that is finest)."""
    region_mm: tuple[Corner, Corner] | None = None
    """Only what lies in this box, [[x0, y0, z0], [x1, y1, z1]], widened to whole voxels. Default: all."""
    memory_mb: float | None = Field(default=None, gt=0)
    """Memory that the whole process may hold; tiles go to the disk as they are done, 320 bytes a brick stay.
    Default: what the machine has free."""
    fiber_shape: Literal["cylinder", "line"] = "cylinder"
    """How fibers fill voxels below four fiber radii; above, both are the same. "line" is quicker, and many
    times too dense where voxels are thinner than a fiber."""
    second_moment: bool = False
    """Also store T, the mean of t t^T over the fiber directions t, as the grids moment_diag (xx, yy, zz) and
    moment_off (xy, xz, yz)."""
    albedo: bool | None = None
    """Also store the mean color of the fibers in each voxel (their plies' colors, with color noise along the
    yarn) as the grid `albedo`, linear RGB. The renderer takes it as the fibers' dye.
    Default: where fibers have colors."""
    levels: int = Field(default=0, ge=0, le=5)
    """Coarser levels to write beside the result, each a volume: 2, 4, 8 ... times the voxel size."""
    level_lobes: Literal[1, 2] = 2
    """Directions in a voxel of a coarser level. With 2, crossing fibers stay apart, as a second medium."""
    picture: bool = False
    """Also draw the whole grid from its broad side, as a .png beside the result; in little memory."""
    tile_voxels: int = Field(default=128, ge=8, le=256, multiple_of=8)
    """Voxels along the edge of the cube that one worker fills at a time; less where memory is short. It
    changes no bit of the result."""
    formats: tuple[Literal["vdb", "nvdb"], ...] = Field(default=("vdb",), min_length=1)
    """Files to write: "vdb" (needs OpenVDB), "nvdb", or both; the first one is what later stages read."""

    @field_validator("region_mm")
    @classmethod
    def _region_has_volume(cls, region: tuple[Corner, Corner] | None) -> tuple[Corner, Corner] | None:
        if region is not None and not all(low < high for low, high in zip(*region, strict=True)):
            raise ValueError(f"the first corner must lie below the second on every axis, got {region}")
        return region

    @field_validator("formats")
    @classmethod
    def _formats_differ(cls, formats: tuple[str, ...]) -> tuple[str, ...]:
        if len(set(formats)) < len(formats):
            raise ValueError(f"a format is named twice: {list(formats)}")
        return formats

    @model_validator(mode="after")
    def _size_is_given_once(self) -> VoxelizeConfig:
        given = (self.voxel_size_mm, self.voxels_per_fiber_diameter, self.voxels_per_pixel)
        if sum(value is not None for value in given) != 1:
            raise ValueError("give either voxel_size_mm or voxels_per_fiber_diameter or voxels_per_pixel")
        return self

    @property
    def size_mm(self) -> float:
        """Edge of a voxel, of a config that names it or that `sized` returned [mm]."""
        if self.voxel_size_mm is None:
            raise ValueError("the voxel size follows from the fibers or the camera; see VoxelizeConfig.sized")
        return self.voxel_size_mm

    def seen_by(self, pixel_mm: float) -> VoxelizeConfig:
        """The same with its voxel size in mm, for a camera whose pixels are this wide where cloth is nearest.

        Rounded down to three digits, so that the last bits of a camera's place make no other grid.
        """
        if self.voxels_per_pixel is None:
            return self
        size = pixel_mm / self.voxels_per_pixel
        step = 10.0 ** (math.floor(math.log10(size)) - 2)
        size = float(f"{math.floor(size / step) * step:.3g}")
        return self.model_copy(update={"voxel_size_mm": size, "voxels_per_pixel": None})

    def colored(self, has_colors: bool) -> VoxelizeConfig:
        """The same with `albedo` decided, for fibers that have colors or none."""
        return self if self.albedo is not None else self.model_copy(update={"albedo": has_colors})

    def sized(self, fiber_radius_mm: Sequence[float]) -> VoxelizeConfig:
        """The same with its voxel size in mm, for fibers of these radii."""
        if self.voxels_per_fiber_diameter is None:
            return self
        size = 2 * min(fiber_radius_mm) / self.voxels_per_fiber_diameter
        return self.model_copy(update={"voxel_size_mm": size, "voxels_per_fiber_diameter": None})
