"""Settings of the fit: the [fit] table."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from weft.fiber_model.scattering.config import AzimuthalTable, Fraction, TailRatio
from weft.fiber_model.scattering.parameters import TABLES, TAILS, Table, check_tables
from weft.files.errors import InputError
from weft.files.input_file import InputFile
from weft.files.when_met import ByKind

WIDTHS = (
    "longitudinal_width_r_deg",
    "longitudinal_width_tt_deg",
    "longitudinal_width_trt_deg",
    "azimuthal_width_tt_deg",
    "azimuthal_width_trt_deg",
)
COLORS = ("fresnel_r", "color_r", "color_tt", "color_trt")
GRAZING = (
    "longitudinal_width_r_grazing_deg",
    "longitudinal_width_tt_grazing_deg",
    "longitudinal_width_trt_grazing_deg",
    "azimuthal_width_tt_grazing_deg",
    "azimuthal_width_trt_grazing_deg",
    "fresnel_tt_grazing",
)
"""Where widths and T go for light along the fiber, in the order of what they belong to."""

ABSORPTION_POWER = 1.9
"""C_TRT = C_TT^1.9: light inside passes the fiber almost twice as far before it leaves as TRT."""

ParameterName = Literal[
    "longitudinal_width_r_deg",
    "longitudinal_width_tt_deg",
    "longitudinal_width_trt_deg",
    "azimuthal_width_tt_deg",
    "azimuthal_width_trt_deg",
    "fresnel_tt",
    "scale",
    "fresnel_r",
    "color_r",
    "color_tt",
    "color_trt",
    "longitudinal_width_r_grazing_deg",
    "longitudinal_width_tt_grazing_deg",
    "longitudinal_width_trt_grazing_deg",
    "azimuthal_width_tt_grazing_deg",
    "azimuthal_width_trt_grazing_deg",
    "fresnel_tt_grazing",
]


def _one_or_more(value: Any) -> Any:
    return value if isinstance(value, list | tuple) else [value]


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)


class ParameterConfig(_Table):
    """What the fit may do with one parameter: leave it free between bounds, hold it, or tie it to another."""

    fixed: float | tuple[float, float, float] | None = None
    """Hold the parameter at this value; three numbers for the channels of a color."""
    tie_to: ParameterName | None = None
    """Hold the parameter at factor * (the other parameter) ** power, channel by channel for colors."""
    factor: Annotated[float, Field(gt=0)] = 1.0
    """Of the tie. A tie between widths wants power 1, so that it means the same in every unit."""
    power: Annotated[float, Field(gt=0)] = 1.0
    """Of the tie."""
    lower: float | None = None
    """Lower bound. Default: the lowest value that the model takes."""
    upper: float | None = None
    """Upper bound. Default: the highest value that the model takes."""

    @model_validator(mode="after")
    def _one_way(self) -> ParameterConfig:
        if self.fixed is not None and (self.tie_to is not None or (self.lower, self.upper) != (None, None)):
            raise ValueError("a fixed parameter takes neither tie_to nor bounds")
        if self.lower is not None and self.upper is not None and not self.lower < self.upper:
            raise ValueError(f"lower must lie below upper, found {self.lower:g} and {self.upper:g}")
        return self


class StatedNoise(_Table):
    """The standard deviations that the measurements state."""

    kind: Literal["stated"] = "stated"


class RelativeNoise(_Table):
    """sigma² = (relative * value)² + (floor * largest value)², with the fitted value, not the noisy one."""

    kind: Literal["relative"] = "relative"
    relative: Annotated[float, Field(gt=0, le=1)] = 0.02
    """Part of the value."""
    floor: Annotated[float, Field(gt=0, le=1)] = 0.001
    """Part of the largest value of the channel."""


class UniformNoise(_Table):
    """One unknown sigma for all values, on the scale of the loss; errors follow from the residuals."""

    kind: Literal["uniform"] = "uniform"


Noise = Annotated[StatedNoise | RelativeNoise | UniformNoise, ByKind()]
Range = tuple[float, float]
Reach = Annotated[float, Field(gt=0, le=180)]


class MaskRegion(_Table):
    """Directions to leave out of the fit: those for which all that is given here is true, in degrees."""

    theta_i_deg: Range | None = None
    """Inclination of the light."""
    theta_o_deg: Range | None = None
    """Inclination of the detector."""
    phi_deg: Range | None = None
    """Azimuth of the detector from the light, within [-180, 180]."""
    beyond_deg: Reach | None = None
    """Light or detector inclined by more than this: grazing."""
    near_specular_deg: Reach | None = None
    """Detector within this of the specular cone, theta_o = -theta_i."""
    near_forward_deg: Reach | None = None
    """Detector within this of the light's way straight through, where the beam itself arrives."""
    near_light_deg: Reach | None = None
    """Detector within this of the light, which it then shades."""

    @model_validator(mode="after")
    def _says_something(self) -> MaskRegion:
        if not self.model_dump(exclude_none=True):
            raise ValueError("a mask without any condition would leave nothing")
        return self


class FitConfig(_Table):
    """Scattering parameters from measured scattering. The result is what `[scattering] fit` takes."""

    measurements: Annotated[
        list[InputFile], BeforeValidator(_one_or_more, json_schema_input_type=str | list[str])
    ]
    """Files of measured scattering, all of one quantity and with the same channels."""
    result: Annotated[str, Field(pattern=r"^[\w][\w.-]*\.json$")] = "fit.json"
    """Name of the result in the output folder; the report lies beside it as .md."""
    longitudinal: Literal["gaussian", "vmf", "symmetric"] = "gaussian"
    """Shape of the lobes along the fiber."""
    azimuthal: Literal["wrapped_normal", "von_mises"] = "wrapped_normal"
    """Shape of the lobes around the fiber."""
    azimuthal_table_r: AzimuthalTable | None = None
    """N of R as [scattering] has it, held as it is; the widths along the fiber and the colors are fitted."""
    azimuthal_table_tt: AzimuthalTable | None = None
    """N of TT; the width that it takes the place of is held at that of the nearest simple lobe."""
    azimuthal_table_trt: AzimuthalTable | None = None
    """N of TRT, likewise."""
    tail_weight_r: Fraction | None = None
    """Tails along the fiber as [scattering] has them, held as they are; so are all that follow."""
    tail_weight_r_grazing: Fraction | None = None
    tail_ratio_r: TailRatio | None = None
    tail_weight_tt: Fraction | None = None
    tail_weight_tt_grazing: Fraction | None = None
    tail_ratio_tt: TailRatio | None = None
    tail_weight_trt: Fraction | None = None
    tail_weight_trt_grazing: Fraction | None = None
    tail_ratio_trt: TailRatio | None = None
    gamma_trt: bool = True
    """Give TRT a width around the fiber; otherwise it is uniform, as in the thesis."""
    grazing: bool = False
    """Let the widths and T change with the inclination of the light, each by one more parameter: its value
    for light along the fiber."""
    gray: bool = False
    """One value for the three channels of each color."""
    parameters: dict[ParameterName, ParameterConfig] = {}
    """What is fixed, tied or bounded. Without an entry: color_r = 1, color_trt = color_tt ** 1.9, the scale
    free where the measurements do not know it and 1 elsewhere, all others free."""
    brightest_tt: bool = False
    """In place of the default tie of color_trt: the largest channel of color_tt is one."""
    loss: Literal["linear", "cube_root", "log"] = "linear"
    """What the residual compares: values, their cube roots, or their logarithms."""
    robust: Literal["none", "huber", "cauchy"] = "none"
    """How residuals beyond `robust_sigmas` are held back."""
    robust_sigmas: Annotated[float, Field(gt=0)] = 2.0
    """Where a residual begins to look like an outlier, in standard deviations."""
    noise: Noise | None = None
    """Default: what the measurements state; relative noise of 2 % where they state none."""
    errors: Literal["auto", "absolute", "scaled"] = "auto"
    """Whether standard errors take sigma at its word, or scale it to chi² = degrees of freedom.
    auto: absolute where the measurements state sigma."""
    intervals: Literal["standard", "profile", "bootstrap"] = "standard"
    """Intervals from the covariance, by profile likelihood, or by a parametric bootstrap."""
    bootstrap_samples: Annotated[int, Field(ge=20, le=10_000)] = 200
    """Refits of the bootstrap."""
    mask: list[MaskRegion] = []
    """Regions of directions to leave out."""
    held_out_theta_i_deg: list[float] = []
    """Inclinations of the light that the fit does not see and that its error is measured at."""
    starts: Annotated[int, Field(ge=1, le=1000)] = 24
    """Random starts of the search."""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    """Of the starts and the bootstrap."""

    @model_validator(mode="after")
    def _grazing_fits(self) -> FitConfig:
        asked = [name for name in self.parameters if name in GRAZING]
        if asked and not self.grazing:
            raise ValueError(f"parameters.{asked[0]} needs grazing = true")
        if self.grazing and self.longitudinal == "symmetric":
            raise ValueError('grazing: widths that change with the angle are not reciprocal; "symmetric" is')
        if self.grazing and self.brightest_tt:
            raise ValueError("grazing: C_TT T and C_TRT (1 - T) at two angles leave brightest_tt no freedom")
        return self

    @property
    def tables(self) -> dict[str, Table]:
        """The tables that are given, by their names."""
        return {name: getattr(self, name) for name in TABLES if getattr(self, name) is not None}

    @property
    def held_shapes(self) -> dict[str, Any]:
        """Tables and tails that are given, by their names."""
        tails = {name: getattr(self, name) for name in TAILS if getattr(self, name) is not None}
        return self.tables | tails

    @model_validator(mode="after")
    def _tails_fit(self) -> FitConfig:
        for lobe in ("r", "tt", "trt"):
            weight, ratio = f"tail_weight_{lobe}", f"tail_ratio_{lobe}"
            given = [name for name in (weight, ratio, f"{weight}_grazing") if name in self.held_shapes]
            missing = [name for name in (weight, ratio) if given and name not in given]
            if missing:
                raise ValueError(f"{given[0]} needs {missing[0]} beside it")
            if given and self.longitudinal == "symmetric":
                raise ValueError(f'{weight} cannot go with the longitudinal kind "symmetric"')
        return self

    @model_validator(mode="after")
    def _tables_fit(self) -> FitConfig:
        try:
            check_tables(self.tables)
        except InputError as error:
            raise ValueError(str(error)) from error
        if self.longitudinal == "symmetric" and any(len(table) > 1 for table in self.tables.values()):
            raise ValueError(
                'a table of several rows changes with the angle, so is not reciprocal; "symmetric" is'
            )
        return self

    @model_validator(mode="after")
    def _ties_end(self) -> FitConfig:
        for name, config in self.parameters.items():
            if config.tie_to is None:
                continue
            if config.tie_to == name or (name in COLORS) != (config.tie_to in COLORS):
                raise ValueError(f"parameters.{name}: cannot be tied to {config.tie_to}")
            source = self.parameters.get(config.tie_to)
            if source is not None and source.tie_to is not None:
                raise ValueError(f"parameters.{name}: {config.tie_to} is itself tied; tie to a free one")
        return self
