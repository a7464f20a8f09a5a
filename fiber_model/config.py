"""Settings of the fiber stage: one yarn type of Zhao, Luan and Bala 2016, and how it is laid along yarns."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, create_model, model_validator

SETTINGS = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)


LARGEST_MM = 1e6
"""A kilometer: far beyond any yarn, and far below where squares overflow."""
SMALLEST_MM = 1e-6


def _zero_or_a_length(value: float) -> float:
    if value != 0 and abs(value) < SMALLEST_MM:
        raise ValueError(f"is {value:g}; must be 0 or at least {SMALLEST_MM:g}")
    return value


Length = Annotated[float, Field(ge=SMALLEST_MM, le=LARGEST_MM)]
Distance = Annotated[float, Field(ge=0, le=LARGEST_MM)]
SignedDistance = Annotated[float, Field(ge=-LARGEST_MM, le=LARGEST_MM)]
Pitch = Annotated[SignedDistance, AfterValidator(_zero_or_a_length)]


class VariationConfig(BaseModel):
    """How a yarn differs from itself along its length: thickness noise, slubs, color noise."""

    model_config = SETTINGS

    thickness_sd: float = Field(default=0.0, ge=0, le=0.5)
    """Standard deviation of the yarn's thickness as a part of its mean; 0.1 to 0.15 for a spun yarn."""
    thickness_length_mm: Length = 20.0
    """Distance along the yarn at which the correlation of thicknesses has fallen to 1/e."""
    slubs_per_m: float = Field(default=0.0, ge=0, le=1e6)
    """Slubs (short thick places) per meter of yarn, at random places."""
    slub_length_mm: Length = 40.0
    """Mean length of a slub, from where it begins to where it ends."""
    slub_length_sd_mm: Distance = 10.0
    """Its standard deviation."""
    slub_thickness: float = Field(default=2.0, ge=1, le=20)
    """Mean thickness in the middle of a slub over that of the yarn beside it."""
    slub_thickness_sd: float = Field(default=0.3, ge=0, le=20)
    """Its standard deviation."""
    thick_places: Literal["more_fibers", "looser"] = "more_fibers"
    """more_fibers: the packing stays, fibers begin and end. looser: the same fibers lie farther apart."""
    color_sd: float = Field(default=0.0, ge=0, le=1)
    """Standard deviation of the color's lightness along the yarn, as a part of its mean."""
    color_length_mm: Length = 20.0
    """Distance along the yarn at which the correlation of colors has fallen to 1/e."""
    yarn_color_sd: float = Field(default=0.0, ge=0, le=1)
    """The same from yarn to yarn: bobbins of several dye lots."""
    ply_color_sd: float = Field(default=0.0, ge=0, le=1)
    """The same from ply to ply: heather and melange."""


class WalkHairsConfig(BaseModel):
    """Hairs that wander: each step turns at random."""

    model_config = SETTINGS

    density_per_mm: float = Field(gt=0, le=1e6)
    """Such hairs per mm of ply, beside the others; `fuzz` multiplies it."""
    length_mm: Length
    """Mean length along the hair; `fuzz` multiplies it."""
    length_sd_mm: Distance = 0.0
    """Its standard deviation (lengths are drawn again until they are above 0)."""
    persistence_mm: Length
    """Distance along the hair over which its direction is forgotten to 1/e; small is crimped."""


class DroopHairsConfig(BaseModel):
    """Hairs that leave the yarn in any direction and hang down."""

    model_config = SETTINGS

    density_per_mm: float = Field(gt=0, le=1e6)
    """Such hairs per mm of ply, beside the others; `fuzz` multiplies it."""
    length_mm: Length
    """Mean length along the hair; `fuzz` multiplies it."""
    length_sd_mm: Distance = 0.0
    """Its standard deviation (lengths are drawn again until they are above 0)."""
    bend_mm: float = Field(ge=1e-3, le=1e3)
    """Distance along the hair in which it turns down by a factor e in tan(half its angle to the vertical)."""
    down: tuple[float, float, float] = (0.0, -1.0, 0.0)
    """Where they hang to; need not have unit length."""

    @model_validator(mode="after")
    def _down_has_a_direction(self) -> DroopHairsConfig:
        if not max(abs(value) for value in self.down) > SMALLEST_MM:
            raise ValueError("'down' has no direction; gravity is [0, -1, 0]")
        return self


Color = tuple[
    Annotated[float, Field(ge=0, le=1)],
    Annotated[float, Field(ge=0, le=1)],
    Annotated[float, Field(ge=0, le=1)],
]


class FiberValues(BaseModel):
    """Plies, fibers and fly-aways of a yarn. Lengths in mm; a preset gives the first 24 values.

    A positive pitch turns counterclockwise around the yarn as it advances (a right-handed helix, Z twist).
    """

    model_config = SETTINGS

    preset: str | None = None
    """Name of the table of presets/fibers/ that the values came from; the caller merges it."""

    plies: int = Field(ge=1, le=64)
    """Plies per yarn, K."""
    fibers_per_ply: int = Field(ge=1, le=100_000)
    """Fibers per ply, m, before `fiber_count_scale`."""
    fiber_radius_mm: Length
    """Radius a of one fiber; not among the fitted values, and never scaled."""
    ply_pitch_mm: Pitch
    """Length of yarn in which the plies turn once around each other, alpha_ply; 0 for no twist."""
    fiber_pitch_mm: Pitch
    """Length of yarn in which the fibers turn once around their ply, alpha; 0 for no twist."""
    ply_center_radius_mm: Distance
    """Distance of the ply centers from the yarn's center, R_ply (half of the fitted files' `yarn_radius`)."""
    cords: int = Field(default=1, ge=1, le=64)
    """Plied yarns that are twisted around each other in turn (a cabled yarn); each has `plies` plies."""
    cord_pitch_mm: Pitch | None = None
    """Length of yarn in which the cords turn once. Default: against the plies, and half as tight as they."""
    ellipse_long_mm: Length
    """Half axis of a ply's cross-section along the circle of ply centers, e_X."""
    ellipse_short_mm: Length
    """Half axis of a ply's cross-section toward the yarn's center, e_Y."""
    cross_section_epsilon: float = Field(ge=0, le=1)
    """Uniform part of the cross-section density, epsilon (equation 1)."""
    cross_section_beta: float = Field(ge=0, le=1e6)
    """How strongly the fibers gather in the middle of the ply, beta (equation 1)."""
    migration_per_turn: float = Field(ge=0, le=1e6)
    """Migration periods per turn of the fiber, s (equation 3); the period is fiber pitch / s."""
    migration_min: float = Field(ge=0, le=1)
    """Smallest radius of a migrating fiber as a part of its own, R_min."""
    migration_max: float = Field(default=1.0, ge=0, le=100)
    """Largest radius of a migrating fiber as a part of its own, R_max."""

    hair_density_per_mm: float = Field(ge=0)
    """Hair fly-aways per mm of ply, rho_hair."""
    hair_z_span_mm: SignedDistance
    """Mean extent of a hair along the yarn, z_span (equation 11)."""
    hair_z_span_sd_mm: Distance
    """Its standard deviation as stored; see `flyaway_sd_factor`."""
    hair_radius_mm: SignedDistance
    """Mean distance from the ply center at which a hair begins, R_min (equation 11)."""
    hair_radius_sd_mm: Distance
    """Its standard deviation as stored."""
    hair_radius_span_mm: SignedDistance
    """Mean growth of that distance over the hair, R_span (equation 11)."""
    hair_radius_span_sd_mm: Distance
    """Its standard deviation as stored."""
    hair_angle_span_deg: float
    """Mean angle around the ply that a hair covers, theta_span (equation 11)."""
    hair_angle_span_sd_deg: float = Field(ge=0)
    """Its standard deviation as stored."""
    loop_density_per_mm: float = Field(ge=0)
    """Loop fly-aways per mm of ply, rho_loop."""
    loop_radius_mm: Distance
    """Mean distance of a loop's peak from the ply center, R_loop."""
    loop_radius_sd_mm: Distance
    """Its standard deviation as stored."""
    flyaway_sd_factor: float = Field(default=0.5, ge=0, le=1e6)
    """Standard deviations over the stored ones, for all fly-aways: the files store twice the normal's."""
    hair_root_inside: bool = True
    """Hairs that would begin outside their ply begin on its border, so that none floats free."""

    scale: Literal["as_fitted", "fit_radius"] = "fit_radius"
    """as_fitted: the preset's own size, whatever the yarn's radius. fit_radius: scaled to that radius."""
    fiber_count_scale: float | None = Field(default=None, gt=0, le=10_000)
    """Factor on `fibers_per_ply`. Default: 1 as fitted; with fit_radius the factor that keeps the packing."""
    ply_separation: Literal["as_fitted", "apart"] | None = None
    """apart: slimmer plies side by side, each touching the yarn's radius. Default: apart with fit_radius."""
    apart_ellipse_scale: float = Field(default=0.82, gt=0, le=1)
    """Factor on both half axes of the plies when they are set apart."""
    apart_ply_pitch_scale: float = Field(default=0.7, ge=1e-6, le=1e6)
    """Factor on the ply pitch when plies are set apart."""
    fuzz: float = Field(default=1.0, ge=0, le=1e6)
    """Factor on the number and on the length of all fly-aways; 0 for none, 2 to 3 reads as knitting wool."""
    fuzz_length: float | None = Field(default=None, ge=0, le=1e6)
    """Factor on the length alone, in place of `fuzz`: 1 keeps their size and changes their number."""
    perturbation: float = Field(default=0.0, ge=0, lt=1)
    """Largest random change of a fiber's radius, as a part of it; 0.125 in the original tool, 0 is none."""
    perturbation_length_mm: Length = 0.5
    """Length over which that random change varies, in mm of yarn."""
    walk_hairs: WalkHairsConfig | None = None
    """`[fibers.walk_hairs]`: hairs that wander at random. Default: none."""
    droop_hairs: DroopHairsConfig | None = None
    """`[fibers.droop_hairs]`: hairs that hang down. Default: none."""
    variation: VariationConfig = VariationConfig()
    """`[fibers.variation]`: slubs, thickness and color noise along the yarn. Default: none."""
    ply_colors: tuple[Color, ...] = Field(default=(), max_length=4096)
    """Linear RGB in 0..1 for each ply, cord after cord; the list repeats. Default: white."""
    yarn_colors: tuple[Color, ...] = Field(default=(), max_length=4096)
    """Linear RGB in 0..1 for each yarn, multiplied into its plies' colors: course after course of a knit, end
    after end of a weave's warp or weft where those are types of their own. The list repeats."""
    yarn_color_runs: tuple[Annotated[int, Field(ge=1, le=100_000)], ...] = Field(
        default=(1,), min_length=1, max_length=4096
    )
    """How many neighboring yarns take each of `yarn_colors`; the list repeats. [6, 2]: stripes."""

    segment_mm: Length | None = None
    """Longest fiber segment, measured along the yarn. Default: from `sagitta_in_fiber_radii`."""
    sagitta_in_fiber_radii: float = Field(default=0.25, gt=0, le=1e6)
    """Largest distance of a typical fiber from its segments, where `segment_mm` is not given."""


if TYPE_CHECKING:

    class FiberTypeConfig(BaseModel):
        """What the call below makes, as far as type checkers need to know."""

else:
    FiberTypeConfig = create_model(
        "FiberTypeConfig",
        __config__=SETTINGS,
        __doc__="Values of one yarn type that differ from those of the others; keys as in [fibers].",
        keys_as_in=(ClassVar[type[BaseModel]], FiberValues),
        # the trailing None is there because Annotated wants at least one remark
        **{
            name: (
                Annotated[field.annotation, *field.metadata, None] | None,
                None,
            )
            for name, field in FiberValues.model_fields.items()
        },
    )


class FibersConfig(FiberValues):
    """Plies, fibers and fly-aways along all yarns."""

    stretch_segments: int = Field(default=24, ge=1, le=256)
    """Segments per stretch, the piece of yarn that is made at a time."""
    hair_segments: int = Field(default=8, ge=1, le=256)
    """Segments per hair."""
    seed: int = Field(default=0, ge=0, lt=2**32)
    """Everything random is a function of this, the yarn, the fiber and the event."""
    by_type: dict[str, FiberTypeConfig] = Field(default_factory=dict)
    """Other values for some yarn types, by name: `[fibers.by_type.weft]` with keys as in this table."""

    @model_validator(mode="before")
    @classmethod
    def _needs_values_or_a_preset(cls, values: Any) -> Any:
        """One clear line where a preset was forgotten, in place of one for each of its values."""
        if isinstance(values, dict) and "plies" not in values and "fibers_per_ply" not in values:
            raise ValueError(
                "a yarn needs its measurements; set 'preset' to one of the fiber presets, such as \"cotton2\""
            )
        return values

    @model_validator(mode="after")
    def _migration_has_a_range(self) -> FibersConfig:
        for name, values in {"": self, **{name: self.for_type(name) for name in self.by_type}}.items():
            low, high = values.migration_min, values.migration_max
            if low > high:
                where = f"by_type.{name}: " if name else ""
                raise ValueError(f"{where}migration_min {low:g} must not exceed migration_max {high:g}")
        return self

    def for_type(self, name: str) -> FibersConfig:
        """The settings of one yarn type: these, with that type's own values on top."""
        own = self.by_type.get(name)
        if own is None:
            return self
        return self.model_copy(update={key: getattr(own, key) for key in own.model_fields_set})
