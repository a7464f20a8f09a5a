"""Settings of the fiber's scattering: the [scattering] table, complete by itself or on top of a preset."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from weft.files.input_file import InputFile

from .parameters import GRAZING, KNOTS, ROWS, TAIL_RATIO, TAILS, FiberScatteringParameters


def _three_channels(value: Any) -> Any:
    """A single number stands for a gray color."""
    return (value, value, value) if isinstance(value, int | float) and not isinstance(value, bool) else value


def _none_for_uniform(value: Any) -> Any:
    return None if value == "uniform" else value


def _rows(value: Any) -> Any:
    """One row may stand for itself."""
    flat = (
        isinstance(value, list | tuple) and value and all(isinstance(number, int | float) for number in value)
    )
    return [value] if flat else value


Fraction = Annotated[float, Field(ge=0, le=1)]
Color = Annotated[
    tuple[Fraction, Fraction, Fraction],
    BeforeValidator(_three_channels, json_schema_input_type=Fraction | tuple[Fraction, Fraction, Fraction]),
]
LongitudinalWidth = Annotated[float, Field(ge=0.5, le=60)]
AzimuthalWidth = Annotated[float, Field(ge=2, le=300)]
AzimuthalWidthOrUniform = Annotated[
    AzimuthalWidth | None,
    BeforeValidator(_none_for_uniform, json_schema_input_type=AzimuthalWidth | Literal["uniform"]),
]

TailRatio = Annotated[float, Field(ge=TAIL_RATIO[0], le=TAIL_RATIO[1])]
Density = Annotated[float, Field(ge=0)]
TableRow = Annotated[tuple[Density, ...], Field(min_length=KNOTS[0], max_length=KNOTS[1])]
AzimuthalTable = Annotated[
    tuple[TableRow, ...],
    Field(min_length=ROWS[0], max_length=ROWS[1]),
    BeforeValidator(_rows, json_schema_input_type=TableRow | tuple[TableRow, ...]),
]


class LobesConfig(BaseModel):
    """The three lobes R, TT, TRT of one fiber. Colors are linear RGB in [0, 1]; one number means gray."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)

    kind: Literal["fibers"] = "fibers"
    """Fibers, as here; jobs also take "isotropic", "henyey_greenstein" and "sggx"."""
    preset: str | None = None
    """Name of the table of presets/scattering/ that the values came from; the caller merges it."""
    fit: InputFile | None = None
    """A .json file of fitted parameters that the values came from; the caller merges it."""

    longitudinal_width_r_deg: LongitudinalWidth
    """Width of the R lobe along the fiber, beta_R: the roughness of the fiber's surface."""
    longitudinal_width_tt_deg: LongitudinalWidth
    """Width of the TT lobe along the fiber, beta_TT."""
    longitudinal_width_trt_deg: LongitudinalWidth
    """Width of the TRT lobe along the fiber, beta_TRT."""
    azimuthal_width_tt_deg: AzimuthalWidth
    """Width of the TT lobe around the fiber, gamma_TT; about 30 for a smooth cylinder, above 200 uniform."""
    azimuthal_width_trt_deg: AzimuthalWidthOrUniform = None
    """Width of the TRT lobe around the fiber, gamma_TRT; default "uniform", as in the thesis."""
    fresnel_r: Color
    """Reflectance at normal incidence F_R; it rises to one at grazing angles (Schlick)."""
    fresnel_tt: Fraction
    """Part T of the light inside the fiber that leaves it at the first passage; the rest becomes TRT."""
    color_r: Color = (1.0, 1.0, 1.0)
    """Color of the R lobe, C_R."""
    color_tt: Color = (1.0, 1.0, 1.0)
    """Color of light that passed through the fiber once, C_TT: the dye."""
    color_trt: Color = (1.0, 1.0, 1.0)
    """Color of light reflected inside, C_TRT; absorption suggests C_TT to the power 1.9."""
    longitudinal: Literal["gaussian", "vmf", "symmetric"] = "gaussian"
    """Shape along the fiber: gaussian (Khungurn et al. 2015), vmf (d'Eon et al. 2011), or symmetric, whose
    light travels backwards as it does forwards (reciprocity)."""
    azimuthal: Literal["wrapped_normal", "von_mises"] = "wrapped_normal"
    """Shape around the fiber, of the lobes that are not uniform."""
    longitudinal_width_r_grazing_deg: LongitudinalWidth | None = None
    """beta_R for light along the fiber; between, widths go with 1 - cos(inclination). Default: no change.
    Light at an angle sees a fiber of higher index (Bravais), so lobes widen. None of these beside the kind
    "symmetric"."""
    longitudinal_width_tt_grazing_deg: LongitudinalWidth | None = None
    """beta_TT for light along the fiber."""
    longitudinal_width_trt_grazing_deg: LongitudinalWidth | None = None
    """beta_TRT for light along the fiber."""
    azimuthal_width_tt_grazing_deg: AzimuthalWidth | None = None
    """gamma_TT for light along the fiber."""
    azimuthal_width_trt_grazing_deg: AzimuthalWidth | None = None
    """gamma_TRT for light along the fiber."""
    fresnel_tt_grazing: Fraction | None = None
    """T for light along the fiber: what enters there is reflected inside more often."""
    azimuthal_table_r: AzimuthalTable | None = None
    """R around the fiber, in place of uniform: densities at equal steps from the lobe's center (back to the
    light; for TT straight on) to the opposite side, in any unit. One row, or 2 to 4 for light at equal steps
    of 1 - cos(inclination) from a right angle to along the fiber. All tables of a fiber have one shape."""
    azimuthal_table_tt: AzimuthalTable | None = None
    """TT around the fiber, in place of azimuthal_width_tt_deg: for fibers that are not round."""
    azimuthal_table_trt: AzimuthalTable | None = None
    """TRT around the fiber, in place of azimuthal_width_trt_deg."""
    tail_weight_r: Fraction | None = None
    """Part of R in a heavy tail along the fiber, for light at a right angle: a rough fiber's lobes fall off
    more slowly than a Gaussian. Default: no tail. None of these beside the kind "symmetric"."""
    tail_weight_r_grazing: Fraction | None = None
    """The same for light along the fiber; between, it goes with 1 - cos(inclination). Default: no change."""
    tail_ratio_r: TailRatio | None = None
    """Width of the tail over beta_R."""
    tail_weight_tt: Fraction | None = None
    """Part of TT in its tail."""
    tail_weight_tt_grazing: Fraction | None = None
    """The same for light along the fiber."""
    tail_ratio_tt: TailRatio | None = None
    """Width of the tail over beta_TT."""
    tail_weight_trt: Fraction | None = None
    """Part of TRT in its tail."""
    tail_weight_trt_grazing: Fraction | None = None
    """The same for light along the fiber."""
    tail_ratio_trt: TailRatio | None = None
    """Width of the tail over beta_TRT."""

    @classmethod
    def from_parameters(cls, parameters: FiberScatteringParameters) -> Self:
        """The table of a parameter set. Angles agree to rounding; colors and fractions exactly."""
        values = {
            (f"{name}_deg" if "_width_" in name else name): (
                math.degrees(value) if "_width_" in name and value is not None else value
            )
            for name, value in asdict(parameters).items()
        }
        return cls(**values)

    def to_parameters(self) -> FiberScatteringParameters:
        around_trt = self.azimuthal_width_trt_deg
        grazing: dict[str, Any] = {name: self._grazing(name) for name in GRAZING}
        return FiberScatteringParameters(
            longitudinal_width_r=math.radians(self.longitudinal_width_r_deg),
            longitudinal_width_tt=math.radians(self.longitudinal_width_tt_deg),
            longitudinal_width_trt=math.radians(self.longitudinal_width_trt_deg),
            azimuthal_width_tt=math.radians(self.azimuthal_width_tt_deg),
            azimuthal_width_trt=None if around_trt is None else math.radians(around_trt),
            fresnel_r=self.fresnel_r,
            fresnel_tt=self.fresnel_tt,
            color_r=self.color_r,
            color_tt=self.color_tt,
            color_trt=self.color_trt,
            longitudinal=self.longitudinal,
            azimuthal=self.azimuthal,
            azimuthal_table_r=self.azimuthal_table_r,
            azimuthal_table_tt=self.azimuthal_table_tt,
            azimuthal_table_trt=self.azimuthal_table_trt,
            **grazing,
            **{name: getattr(self, name) for name in TAILS},
        )

    def _grazing(self, name: str) -> float | None:
        value = getattr(self, f"{name}_deg" if "_width_" in name else name)
        return math.radians(value) if "_width_" in name and value is not None else value


class ScatteringConfig(LobesConfig):
    """How the fibers scatter light; `by_type` gives single yarn types lobes of their own."""

    by_type: dict[str, LobesConfig] = {}
    """Lobes by yarn type, for types that differ; the caller completes them from this table or a preset."""

    def parameters_for(self, yarn_type: str) -> FiberScatteringParameters:
        return self.by_type.get(yarn_type, self).to_parameters()
