"""Settings of surfaces: meshes from files, a ground, and what they are made of."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from weft.files.input_file import InputFile
from weft.files.when_met import ByKind

from .settings import Reflectance, Settings, Share, Vector

Positive = Annotated[float, Field(gt=0)]


class DiffuseMaterial(Settings):
    """Lambert's law, on both sides."""

    kind: Literal["diffuse"] = "diffuse"
    color: Reflectance = (0.5, 0.5, 0.5)
    """Linear RGB reflectance; a texture is multiplied by it."""
    texture: InputFile | None = None
    """PNG or JPEG in sRGB over u, v; repeated outside of [0, 1], v upward."""


class PrincipledMaterial(Settings):
    """Disney's principled BRDF (Burley 2012)."""

    kind: Literal["principled"] = "principled"
    color: Reflectance = (0.5, 0.5, 0.5)
    """Linear RGB base color; a texture is multiplied by it."""
    texture: InputFile | None = None
    """PNG or JPEG in sRGB over u, v; repeated outside of [0, 1], v upward."""
    subsurface: Share = 0.0
    """Diffuse shape of a subsurface approximation."""
    metallic: Share = 0.0
    """0 dielectric, 1 metal."""
    specular: Share = 0.5
    """Specular reflection at normal incidence, in units of 8 percent."""
    specular_tint: Share = 0.0
    """Of the specular reflection toward the base color."""
    roughness: Share = 0.5
    """Of diffuse and specular response; the width of highlights is its square."""
    anisotropic: Share = 0.0
    """Stretches highlights along the texture's u."""
    sheen: Share = 0.0
    """Light at grazing angles, as of cloth."""
    sheen_tint: Share = 0.5
    """Of the sheen toward the base color."""
    clearcoat: Share = 0.0
    """A second, colorless specular layer."""
    clearcoat_gloss: Share = 1.0
    """0 satin, 1 gloss."""


class MerlMaterial(Settings):
    """A measured isotropic BRDF of the MERL database (Matusik et al. 2003), on both sides."""

    kind: Literal["merl"] = "merl"
    file: InputFile
    """A .binary file of 90 x 90 x 180 cells."""


Material = Annotated[DiffuseMaterial | PrincipledMaterial | MerlMaterial, ByKind()]


class Placement(Settings):
    """Where a mesh stands: scaled, turned about x, then y, then z, moved."""

    scale: Positive | tuple[Positive, Positive, Positive] = 1.0
    """Factor on the mesh's size, or one along each of its axes."""
    rotation_deg: Vector = (0.0, 0.0, 0.0)
    """About the axes x, y and z, in this order, each counterclockwise seen from its tip."""
    position_mm: Vector = (0.0, 0.0, 0.0)
    """Where the file's origin comes to lie."""

    @property
    def scale_xyz(self) -> np.ndarray:
        """Shape [3]."""
        return np.broadcast_to(np.asarray(self.scale, np.float64), 3)


class MeshSurface(Settings):
    """Triangles from an OBJ, PLY, glTF or STL file."""

    kind: Literal["mesh"] = "mesh"
    file: InputFile
    """The mesh; all objects of a scene together."""
    unit_mm: float = Field(default=1.0, gt=0)
    """Length of the file's unit; glTF files are in meters, 1000."""
    smooth: bool = True
    """Shade with the normals of the vertices; otherwise flat triangles are seen."""
    placements: tuple[Placement, ...] = Field(default=(Placement(),), min_length=1, max_length=4096)
    """One copy of the mesh for each."""
    material: Material = DiffuseMaterial()
    """What it is made of."""


class Stencil(Settings):
    """A closed mesh; the volume is cut out along it, voxel by voxel. It is not itself seen."""

    file: InputFile
    """OBJ, PLY, glTF or STL, every edge between two triangles."""
    unit_mm: float = Field(default=1.0, gt=0)
    """Length of the file's unit; glTF files are in meters, 1000."""
    placement: Placement = Placement()
    """Where it stands."""


class GroundSurface(Settings):
    """A square under, or behind, the volume."""

    kind: Literal["ground"] = "ground"
    normal: Vector = (0.0, 1.0, 0.0)
    """Toward the volume; (0, 0, 1) for a cloth that lies in the plane of x and y."""
    gap_mm: float = 0.0
    """Between ground and volume, along the normal."""
    size_mm: float | None = Field(default=None, gt=0)
    """Side of the square; unset: ten times the diagonal of the volume."""
    texture_size_mm: float = Field(default=100.0, gt=0)
    """Side of the square that one copy of the texture covers."""
    material: Material = DiffuseMaterial()
    """What it is made of."""


class BallSurface(Settings):
    """A ball, as 1,280 triangles with the normals of a sphere."""

    kind: Literal["ball"] = "ball"
    position_mm: Vector = (0.0, 0.0, 0.0)
    """Its middle."""
    radius_mm: float = Field(default=1.0, gt=0)
    """From its middle."""
    material: Material = DiffuseMaterial()
    """What it is made of."""


class TubeSurface(Settings):
    """A round bar, or bent wire, along straight legs: a rail, a hanger."""

    kind: Literal["tube"] = "tube"
    points_mm: tuple[Vector, ...] = Field(min_length=2, max_length=4096)
    """Where it begins, bends and ends."""
    radius_mm: float = Field(default=1.0, gt=0)
    """Of its round section."""
    material: Material = DiffuseMaterial()
    """What it is made of."""

    @model_validator(mode="after")
    def _bends_are_possible(self) -> TubeSurface:
        legs = np.diff(np.array(self.points_mm), axis=0)
        lengths = np.linalg.norm(legs, axis=1)
        if not (lengths > 1e-6).all():
            raise ValueError("two neighboring points of a tube are the same")
        turns = np.einsum("ij,ij->i", legs[:-1], legs[1:]) / (lengths[:-1] * lengths[1:])
        if (turns < -0.9).any():
            raise ValueError("a tube turns back by more than 150 degrees at a point; take more points")
        return self


SweptParameter = Literal[
    "subsurface",
    "metallic",
    "specular",
    "specular_tint",
    "roughness",
    "anisotropic",
    "sheen",
    "sheen_tint",
    "clearcoat",
    "clearcoat_gloss",
]


class SweepRow(Settings):
    """Balls of one principled material that differ in one parameter."""

    parameter: SweptParameter
    """What differs."""
    material: PrincipledMaterial = PrincipledMaterial()
    """All else."""


class SweepSurface(Settings):
    """Balls in rows, one row per swept parameter, one ball per value: a sheet of materials."""

    kind: Literal["sweep"] = "sweep"
    rows: tuple[SweepRow, ...] = Field(min_length=1, max_length=64)
    """One for each parameter."""
    values: tuple[Share, ...] = Field(default=(0.0, 0.25, 0.5, 0.75, 1.0), min_length=1, max_length=64)
    """Of the parameter, ball by ball."""
    position_mm: Vector = (0.0, 0.0, 0.0)
    """Middle of the first ball."""
    radius_mm: float = Field(default=1.0, gt=0)
    """Of each ball."""
    step_mm: Vector = (0.0, -2.4, 0.0)
    """From a value to the next."""
    row_step_mm: Vector = (2.4, 0.0, 0.0)
    """From a parameter to the next."""

    @model_validator(mode="after")
    def _not_too_many(self) -> SweepSurface:
        if len(self.rows) * len(self.values) > 512:
            raise ValueError(f"{len(self.rows)} x {len(self.values)} balls; at most 512")
        return self


Surface = MeshSurface | GroundSurface | BallSurface | TubeSurface | SweepSurface
