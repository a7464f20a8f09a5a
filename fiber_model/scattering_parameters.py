"""Parameters of the three-lobe fiber scattering model, shared by the fit, the presets and the renderer."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class FiberScatteringParameters:
    """Three-lobe fiber scattering (R, TT, TRT), extending Khungurn et al. 2015 (thesis section 6.2).

    Angles in radians. Colors are linear RGB in [0, 1]. Energies, with F the Schlick Fresnel term from `fresnel_r`
    and T = `fresnel_tt`: a_R = C_R F, a_TT = C_TT (1-F) T, a_TRT = C_TRT (1-F) (1-T).
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
    """Kind of the longitudinal lobes: gaussian | vmf | symmetric."""
    azimuthal: str = "wrapped_normal"
    """Kind of the azimuthal lobes: wrapped_normal | von_mises."""
