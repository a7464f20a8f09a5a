"""Parameters of the three-lobe fiber scattering model, shared by the fit, the presets and the renderer."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from weft.files.errors import InputError

LONGITUDINAL_KINDS = ("gaussian", "vmf", "symmetric")
AZIMUTHAL_KINDS = ("wrapped_normal", "von_mises")


@dataclass(frozen=True)
class FiberScatteringParameters:
    """Three-lobe fiber scattering (R, TT, TRT), extending Khungurn et al. 2015 (thesis section 6.2).

    Angles in radians. Colors are linear RGB in [0, 1]. Energies, with F the Schlick Fresnel term from
    `fresnel_r` and T = `fresnel_tt`: a_R = C_R F, a_TT = C_TT (1-F) T, a_TRT = C_TRT (1-F) (1-T).
    """

    longitudinal_width_r: float
    longitudinal_width_tt: float
    longitudinal_width_trt: float
    azimuthal_width_tt: float
    fresnel_r: tuple[float, float, float]
    fresnel_tt: float
    color_r: tuple[float, float, float] = (1.0, 1.0, 1.0)
    color_tt: tuple[float, float, float] = (1.0, 1.0, 1.0)
    color_trt: tuple[float, float, float] = (1.0, 1.0, 1.0)
    azimuthal_width_trt: float | None = None
    """None: the TRT lobe is uniform around the fiber, as in the thesis."""
    longitudinal: str = "gaussian"
    """Kind of the longitudinal lobes: gaussian | vmf | symmetric (reciprocal)."""
    azimuthal: str = "wrapped_normal"
    """Kind of the azimuthal lobes: wrapped_normal | von_mises."""

    def __post_init__(self) -> None:
        _check_kind("longitudinal", self.longitudinal, LONGITUDINAL_KINDS)
        _check_kind("azimuthal", self.azimuthal, AZIMUTHAL_KINDS)
        for field in fields(self):
            value = getattr(self, field.name)
            if value is None or isinstance(value, str):
                continue
            if field.name.startswith("longitudinal_width"):
                _check_angle(field.name, value, 0.5, 60.0)
            elif field.name.startswith("azimuthal_width"):
                _check_angle(field.name, value, 2.0, 300.0)
            else:
                _check_unit_interval(field.name, value)


def _check_kind(name: str, value: str, known: tuple[str, ...]) -> None:
    if value not in known:
        raise InputError(f"scattering: {name} kind '{value}' is unknown", hint=f"Known: {', '.join(known)}.")


def _check_angle(name: str, radians: float, least_deg: float, most_deg: float) -> None:
    degrees = math.degrees(radians)
    # the range that the tests of normalization and sampling cover; 1e-9 forgives the conversion to radians
    if not least_deg - 1e-9 <= degrees <= most_deg + 1e-9:
        raise InputError(
            f"scattering: {name} is {degrees:g} deg; it must lie in [{least_deg:g}, {most_deg:g}] deg"
        )


def _check_unit_interval(name: str, value: float | tuple[float, ...]) -> None:
    for number in value if isinstance(value, tuple) else (value,):
        if not 0.0 <= number <= 1.0:
            raise InputError(f"scattering: {name} is {number:g}; an energy fraction must lie in [0, 1]")
