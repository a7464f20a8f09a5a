"""Settings of lights that stand somewhere in the scene."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from weft.files.input_file import InputFile

from .settings import Color, Settings, Vector
from .surface_config import Placement


class PointLight(Settings):
    """Light from a point, the same in all directions."""

    kind: Literal["point"] = "point"
    position_mm: Vector
    """Where it is."""
    intensity: Color
    """Irradiance at a distance of 1 mm; it falls with the square, so 4e4 gives 1 at 200 mm."""


class SpotLight(Settings):
    """Light from a point in a cone, full inside of the beam and fading evenly by angle to its edge."""

    kind: Literal["spot"] = "spot"
    position_mm: Vector
    """Where it is."""
    target_mm: Vector | None = None
    """What it points at; unset: the middle of the volume."""
    intensity: Color
    """Irradiance at a distance of 1 mm in the beam; it falls with the square of the distance."""
    cutoff_deg: float = Field(default=20.0, gt=0, lt=180)
    """Angle from the axis to where it is dark."""
    beam_deg: float = Field(default=15.0, ge=0, lt=180)
    """Angle from the axis to where it begins to fade."""

    @model_validator(mode="after")
    def _beam_inside_of_the_cone(self) -> SpotLight:
        if self.beam_deg >= self.cutoff_deg:
            raise ValueError(f"beam_deg {self.beam_deg} must be smaller than cutoff_deg {self.cutoff_deg}")
        return self


class _AreaLight(Settings):
    position_mm: Vector
    """Its middle."""
    target_mm: Vector | None = None
    """What its bright side faces; the other one is black. Unset: the middle of the volume."""
    radiance: Color
    """The same at every place and angle."""


class QuadLight(_AreaLight):
    """A bright rectangle, such as a softbox or a window. Camera rays see it."""

    kind: Literal["quad"] = "quad"
    width_mm: float = Field(gt=0)
    """Across."""
    height_mm: float = Field(gt=0)
    """Along `up`, as far as it can be."""
    up: Vector = (0.0, 1.0, 0.0)
    """Roughly along its height."""


class DiskLight(_AreaLight):
    """A bright disk, such as a lamp's reflector. Camera rays see it."""

    kind: Literal["disk"] = "disk"
    radius_mm: float = Field(gt=0)
    """From its middle to its edge."""


class MeshLight(Settings):
    """A bright mesh. Its front shines, where the vertices run counterclockwise. Camera rays see it."""

    kind: Literal["mesh"] = "mesh"
    file: InputFile
    """OBJ, PLY, glTF or STL, of at most 65,536 triangles."""
    unit_mm: float = Field(default=1.0, gt=0)
    """Length of the file's unit; glTF files are in meters, 1000."""
    placement: Placement = Placement()
    """Where it stands."""
    radiance: Color
    """The same at every place and angle."""


class SoftboxLight(Settings):
    """A bright rectangle that faces the volume, placed as a photographer would: around the view."""

    kind: Literal["softbox"] = "softbox"
    azimuth_deg: float = -45.0
    """Around the picture's upward axis from the camera; negative on the left, 180 behind the volume."""
    elevation_deg: float = Field(default=45.0, ge=-90, le=90)
    """Upward from the view."""
    distance_mm: float | None = Field(default=None, gt=0)
    """From the middle of the volume; unset: twice its diagonal."""
    width_mm: float | None = Field(default=None, gt=0)
    """Across; unset: half the distance."""
    height_mm: float | None = Field(default=None, gt=0)
    """Along the picture's upward axis; unset: half the distance."""
    irradiance: Color = (3.0, 3.0, 3.0)
    """On a surface in the middle that faces it: a larger softbox is softer, not brighter."""
