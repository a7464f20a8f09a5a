"""What can be asked for as the surface of a garment: a mesh file, or a built-in shape."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from weft.files.input_file import InputFile
from weft.files.when_met import ByKind

Length = Annotated[float, Field(gt=0, le=1e5, allow_inf_nan=False)]
FoldCount = Annotated[float, Field(ge=0, le=100, allow_inf_nan=False)]
FoldDepth = Annotated[float, Field(ge=0, le=1e4, allow_inf_nan=False)]


class _Config(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)


class SleeveConfig(_Config):
    """A sleeve around the y axis, cuff down, folds at the elbow on its +z side, its seam at the back."""

    kind: Literal["sleeve"]
    length_mm: Length = 400.0
    """Length of the cloth along the sleeve."""
    cuff_girth_mm: Length = 180.0
    """Around the lower end."""
    top_girth_mm: Length = 300.0
    """Around the upper end. The cloth is cut for the mean of both girths and stretches from there."""
    fold_count: FoldCount = 3.0
    """Folds at the elbow."""
    fold_depth_mm: FoldDepth = 20.0
    """From valley to crest of the deepest fold."""
    step_mm: Length = 2.0
    """Size of the mesh's triangles."""

    @model_validator(mode="after")
    def _folds_leave_room(self) -> Self:
        girth = min(self.cuff_girth_mm, self.top_girth_mm)
        if self.fold_depth_mm > 0.15 * girth:
            found = f"'fold_depth_mm' = {self.fold_depth_mm:g}"
            raise ValueError(f"{found} is too deep for this girth; at most {0.15 * girth:.3g}")
        steepest = 0.5 * self.fold_depth_mm * 2 * 3.1416 * self.fold_count / (0.6 * self.length_mm)
        if steepest > 0.9:
            most = 0.9 * self.fold_depth_mm / steepest
            raise ValueError(f"folds this close are too steep; 'fold_depth_mm' can be at most {most:.3g}")
        return self


class ScarfConfig(_Config):
    """A scarf that hangs along y in pleats toward +z, bent but stretched nowhere."""

    kind: Literal["scarf"]
    width_mm: Length = 200.0
    """Width of the flat cloth."""
    length_mm: Length = 400.0
    """Length of the cloth."""
    fold_count: FoldCount = 3.0
    """Pleats over the width."""
    fold_depth_mm: FoldDepth = 20.0
    """From valley to crest of a pleat."""
    rail_radius_mm: Annotated[float, Field(ge=0, le=1e4, allow_inf_nan=False)] = 0.0
    """With it the scarf lies over a rail along x, its front and back hanging down; 0 for none. The pleats end
    on the rail, where the cloth lies flat, and so gather the cloth below by a few percent."""
    front_share: Annotated[float, Field(gt=0, lt=1)] = 0.55
    """Of the length, what hangs in front of the rail's top."""
    step_mm: Length = 2.0
    """Size of the mesh's triangles."""

    @model_validator(mode="after")
    def _pleats_are_possible(self) -> Self:
        steepest = 3.1416 * self.fold_count * self.fold_depth_mm / self.width_mm
        if steepest > 0.95:
            most = 0.95 * self.fold_depth_mm / steepest
            raise ValueError(f"pleats this close are too steep; 'fold_depth_mm' can be at most {most:.3g}")
        return self


class MeshConfig(_Config):
    """A triangle mesh from a file: .obj, .ply, .glb, .gltf, or .usd, .usda, .usdc, .usdz."""

    kind: Literal["mesh"]
    file: InputFile
    """Path to the file; its suffix tells the format."""
    frame: Annotated[int, Field(ge=-1_000_000, le=10_000_000)] | None = None
    """Time code at which to read a .usd file that moves; by default what it says without one."""
    rest: InputFile | None = None
    """The same mesh in a frame that all others share, so that fibers turn with their yarn."""
    scale_to_mm: Length | None = None
    """Length of one unit of the file in mm. Needed for .obj, .ply and USD files that do not say."""
    up_axis: Literal["y", "z"] | None = None
    """Axis that points up in a file that does not say, y by default; glTF and most USD files know theirs."""
    uv: Literal["auto", "file", "unwrap", "panels"] = "auto"
    """Surface coordinates: the file's own, charts cut by xatlas, or panels that face front (+z) and back.

    auto takes the file's, or unwraps where there are none.
    """
    uv_unit_mm: Length | None = None
    """Length of one unit of the file's (u, v) on the cloth; by default found from the area of the surface."""

    @model_validator(mode="after")
    def _suffix_and_unit(self) -> Self:
        suffix = self.file.suffix.lower()
        if suffix not in (".obj", ".ply", ".glb", ".gltf", ".usd", ".usda", ".usdc", ".usdz"):
            known = ".obj, .ply, .glb, .gltf, .usd, .usda, .usdc and .usdz"
            raise ValueError(f"cannot read meshes from '{suffix}' files, only {known}")
        if suffix in (".obj", ".ply") and self.scale_to_mm is None:
            raise ValueError(f"{suffix} files do not hold their unit, so 'scale_to_mm' must be given")
        if self.frame is not None and not suffix.startswith(".usd"):
            raise ValueError(f"'frame' has no effect on {suffix} files, which do not move")
        if suffix in (".glb", ".gltf") and self.up_axis is not None:
            raise ValueError(f"{suffix} files know which axis is up; remove 'up_axis'")
        if self.uv in ("unwrap", "panels") and self.uv_unit_mm is not None:
            raise ValueError(
                "'uv_unit_mm' is the unit of the file's own (u, v); remove it where uv = 'unwrap'"
            )
        return self


SurfaceConfig = Annotated[MeshConfig | SleeveConfig | ScarfConfig, ByKind()]
"""The [yarns.surface] table of a garment."""
