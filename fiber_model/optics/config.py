"""Settings of the light transport through one fiber: its cross-section, its material, and what to record."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from weft.files.when_met import ByKind

SETTINGS = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)

Length = Annotated[float, Field(ge=1e-5, le=10)]
"""From 10 nm to 1 cm."""


class CircleConfig(BaseModel):
    """A round fiber."""

    model_config = SETTINGS

    kind: Literal["circle"] = "circle"
    radius_mm: Length
    """Radius."""


class EllipseConfig(BaseModel):
    """An oval or ribbon-like fiber."""

    model_config = SETTINGS

    kind: Literal["ellipse"] = "ellipse"
    semi_axes_mm: tuple[Length, Length]
    """The two semi-axes, at most 20 to 1."""

    @model_validator(mode="after")
    def _not_too_flat(self) -> EllipseConfig:
        if max(self.semi_axes_mm) > 20 * min(self.semi_axes_mm):
            raise ValueError("semi_axes_mm: one may be at most 20 times the other")
        return self


class LobedConfig(BaseModel):
    """r = r0 (1 + e cos(n phi)): three lobes are trilobal polyester, many shallow ones serrated viscose."""

    model_config = SETTINGS

    kind: Literal["lobed"] = "lobed"
    radius_mm: Length
    """Mean radius r0."""
    lobes: int = Field(3, ge=2, le=24)
    """Number of lobes n."""
    depth: float = Field(0.15, ge=0, le=0.6)
    """Depth e of the lobes as a part of r0."""
    flatness: float = Field(1.0, ge=0.2, le=1)
    """The outline is scaled by this in one direction: 1 leaves it round."""


class KidneyConfig(BaseModel):
    """An ellipse bent along an arc: a bean, or the collapsed tube of a ripe cotton fiber."""

    model_config = SETTINGS

    kind: Literal["kidney"] = "kidney"
    width_mm: Length
    """Length of the bent midline."""
    thickness_mm: Length
    """Largest thickness across it."""
    bend_deg: float = Field(90, ge=1, le=200)
    """Angle by which the midline turns from end to end."""

    @model_validator(mode="after")
    def _inner_side_does_not_fold(self) -> KidneyConfig:
        thinnest, thickest = (
            self.width_mm / 20,
            min(self.width_mm, 1.6 * self.width_mm * 57.3 / self.bend_deg),
        )
        if not thinnest <= self.thickness_mm <= thickest:
            raise ValueError(
                f"thickness_mm must lie between {thinnest:.3g} and {thickest:.3g} for this width and bend"
            )
        return self


class RoundedTriangleConfig(BaseModel):
    """An equilateral triangle with round corners: silk."""

    model_config = SETTINGS

    kind: Literal["rounded_triangle"] = "rounded_triangle"
    side_mm: Length
    """Side of the triangle before its corners are rounded."""
    corner_radius_mm: Length
    """Radius of the corners; at most 0.28 of the side."""

    @model_validator(mode="after")
    def _corners_fit(self) -> RoundedTriangleConfig:
        if self.corner_radius_mm > 0.28 * self.side_mm:
            raise ValueError(
                "corner_radius_mm may be at most 0.28 of side_mm (0.289 is the inscribed circle)"
            )
        return self


class PolygonConfig(BaseModel):
    """Any simple polygon, convex or not."""

    model_config = SETTINGS

    kind: Literal["polygon"] = "polygon"
    vertices_mm: Annotated[tuple[tuple[float, float], ...], Field(min_length=3, max_length=512)]
    """Corners in order, in either sense; the sides must not cross."""


CrossSectionConfig = Annotated[
    CircleConfig | EllipseConfig | LobedConfig | KidneyConfig | RoundedTriangleConfig | PolygonConfig,
    ByKind(),
]


def _three_channels(value: Any) -> Any:
    return (value, value, value) if isinstance(value, int | float) and not isinstance(value, bool) else value


Absorption = Annotated[float, Field(ge=0, le=1e5)]
Inclination = Annotated[float, Field(ge=-85, le=85)]


class FiberOpticsConfig(BaseModel):
    """One fiber, the light on it, and the bins that the scattered light is counted in."""

    model_config = SETTINGS

    cross_section: CrossSectionConfig
    """Shape of the fiber across its axis."""
    refractive_index: float = Field(ge=1.01, le=3)
    """Of the fiber against the air around it."""
    roughness: float = Field(0.0, ge=0, le=0.8)
    """GGX alpha of the fiber's surface: the tangent of its typical slope. 0: smooth."""
    absorption_per_mm: Annotated[
        tuple[Absorption, Absorption, Absorption],
        BeforeValidator(
            _three_channels, json_schema_input_type=Absorption | tuple[Absorption, Absorption, Absorption]
        ),
    ] = (0.0, 0.0, 0.0)
    """Absorption coefficient of red, green and blue light: exp(-absorption * length) is left."""
    theta_i_deg: Annotated[tuple[Inclination, ...], Field(min_length=1, max_length=90)] = (
        0,
        15,
        30,
        45,
        60,
        75,
    )
    """Inclinations of the light from the normal plane."""
    paths: int = Field(1_000_000, ge=1, le=2**31)
    """Light paths for each inclination."""
    seed: int = Field(0, ge=0, le=2**31)
    """Of the random numbers: the same seed gives the same bits."""
    theta_bin_deg: float = Field(2.5, ge=0.5, le=30)
    """Size of the bins in inclination, which are centered at its multiples; must divide 90."""
    phi_bin_deg: float = Field(10, ge=0.5, le=90)
    """Size of the bins in azimuth, which are centered at its multiples; must divide 180."""
    reflection_floor: float = Field(0.25, ge=0, le=0.5)
    """The first two reflections are followed at least this often, with less weight, to sharpen R and TRT."""

    @model_validator(mode="after")
    def _bins_divide_the_sphere(self) -> FiberOpticsConfig:
        for name, whole in (("theta_bin_deg", 90), ("phi_bin_deg", 180)):
            parts = whole / getattr(self, name)
            if abs(parts - round(parts)) > 1e-9:
                raise ValueError(f"{name} must divide {whole}")
        return self
