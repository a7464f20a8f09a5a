"""Settings of media that are no fibers: phase functions, homogeneous media and bounds, further grids."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from weft.files.input_file import InputFile
from weft.files.when_met import ByKind

from .settings import Color, Reflectance, Settings, Vector
from .simple_phases import HenyeyGreensteinPhase, IsotropicPhase, SggxPhase, SimplePhase
from .surface_config import Stencil


def _three_channels(value: Any) -> Any:
    """A single number stands for a gray color."""
    return (value, value, value) if isinstance(value, int | float) and not isinstance(value, bool) else value


Albedo = Annotated[
    Reflectance, BeforeValidator(_three_channels, json_schema_input_type=float | tuple[float, float, float])
]
Amount = Annotated[
    Color, BeforeValidator(_three_channels, json_schema_input_type=float | tuple[float, float, float])
]
"""Linear RGB; one number means gray."""


class _Simple(Settings):
    """What all of them have."""

    albedo: Albedo = (1.0, 1.0, 1.0)
    """What a collision leaves of the light."""
    emission: Amount = (0.0, 0.0, 0.0)
    """Radiance emitted per optical depth: an opaque medium that scatters nothing has this radiance."""


class IsotropicScattering(_Simple):
    """The same into all directions."""

    kind: Literal["isotropic"] = "isotropic"

    def to_phase(self) -> SimplePhase:
        return IsotropicPhase(self.albedo, self.emission)


class HenyeyGreensteinScattering(_Simple):
    """Henyey and Greenstein 1941."""

    kind: Literal["henyey_greenstein"] = "henyey_greenstein"
    g: float = Field(gt=-1, lt=1)
    """Mean cosine: above 0 forward, below it backward."""

    def to_phase(self) -> SimplePhase:
        return HenyeyGreensteinPhase(self.g, self.albedo, self.emission)


class SggxScattering(_Simple):
    """Specular microflakes along the fibers (Heitz et al. 2015), S = diag(roughness^2, 1, 1)."""

    kind: Literal["sggx"] = "sggx"
    roughness: float = Field(gt=0, le=1)
    """0: flakes are fibers; 1: they point everywhere."""

    def to_phase(self) -> SimplePhase:
        return SggxPhase(self.roughness, self.albedo, self.emission)


class BoxBound(Settings):
    """A box along the axes."""

    kind: Literal["box"] = "box"
    lower_mm: Vector
    """Its lowest corner."""
    upper_mm: Vector
    """Its highest corner."""

    @model_validator(mode="after")
    def _has_room(self) -> BoxBound:
        if not all(low < high for low, high in zip(self.lower_mm, self.upper_mm, strict=True)):
            raise ValueError("lower_mm must lie below upper_mm on every axis")
        return self

    @property
    def bounds_mm(self) -> np.ndarray:
        """Shape [2, 3]."""
        return np.array([self.lower_mm, self.upper_mm])


class BallBound(Settings):
    """A ball."""

    kind: Literal["ball"] = "ball"
    position_mm: Vector = (0.0, 0.0, 0.0)
    """Its middle."""
    radius_mm: float = Field(gt=0)
    """From its middle."""

    @property
    def bounds_mm(self) -> np.ndarray:
        """Shape [2, 3]."""
        return np.array(self.position_mm) + self.radius_mm * np.array([[-1.0], [1.0]])


class MeshBound(Stencil):
    """A closed mesh, exact to half a voxel of the volume."""

    kind: Literal["mesh"] = "mesh"


MediumScattering = Annotated[IsotropicScattering | HenyeyGreensteinScattering, ByKind()]
Bound = Annotated[BoxBound | BallBound | MeshBound, ByKind()]


class HomogeneousMedium(Settings):
    """The same everywhere within its bound; media that overlap add up."""

    kind: Literal["homogeneous"] = "homogeneous"
    bound: Bound
    """Where it is."""
    extinction_per_mm: Amount
    """Linear RGB, or one number; colors may differ."""
    scattering: MediumScattering = IsotropicScattering()
    """What a collision does."""


class GridMedium(Settings):
    """Another volume on voxels of the same size, as smoke: its density times an extinction."""

    kind: Literal["grid"] = "grid"
    file: InputFile
    """A .vdb or .nvdb file of weft; all of its media become this one."""
    extinction_per_mm: Amount
    """Of density 1, toward all directions. Linear RGB, or one number; colors may differ."""
    scattering: MediumScattering = IsotropicScattering()
    """What a collision does."""


Medium = Annotated[HomogeneousMedium | GridMedium, ByKind()]
