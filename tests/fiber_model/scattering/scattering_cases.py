"""Parameter sets that tests of the fiber's scattering share."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from math import radians
from pathlib import Path

import numpy as np

from weft.fiber_model.scattering.config import ScatteringConfig
from weft.fiber_model.scattering.parameters import GRAZING, FiberScatteringParameters

PRESETS = Path(__file__).resolve().parents[3] / "configs" / "presets" / "scattering"
PRESET_NAMES = sorted(path.stem for path in PRESETS.glob("*.toml"))


def preset(name: str, **changes) -> FiberScatteringParameters:
    table = tomllib.loads((PRESETS / f"{name}.toml").read_text(encoding="utf-8"))
    return ScatteringConfig(**{**table, **changes}).to_parameters()


def gray(
    betas_deg=(6.0, 12.0, 24.0),
    gamma_deg: float = 220.0,
    *,
    gamma_trt_deg: float | None = None,
    fresnel_r: float = 0.04,
    longitudinal: str = "gaussian",
    azimuthal: str = "wrapped_normal",
) -> FiberScatteringParameters:
    """A white fiber: energies sum to one at every angle."""
    return FiberScatteringParameters(
        *(radians(beta) for beta in betas_deg),
        azimuthal_width_tt=radians(gamma_deg),
        azimuthal_width_trt=None if gamma_trt_deg is None else radians(gamma_trt_deg),
        fresnel_r=(fresnel_r,) * 3,
        fresnel_tt=0.7,
        longitudinal=longitudinal,
        azimuthal=azimuthal,
    )


def grazing(
    parameters: FiberScatteringParameters, widths_deg, fresnel_tt: float | None = None
) -> FiberScatteringParameters:
    """The same with widths of its own for light along the fiber: beta of R, TT, TRT, gamma of TT, TRT."""
    widths = [None if width is None else radians(width) for width in widths_deg]
    return replace(parameters, **dict(zip(GRAZING, [*widths, fresnel_tt], strict=True)))


def humps(rows: int, knots: int, *, seed: int) -> tuple[tuple[float, ...], ...]:
    """Densities of two or three humps of random places, widths and heights, and a gap without light."""
    rng, angle = np.random.default_rng(seed), np.linspace(0, np.pi, knots)
    table = []
    for _ in range(rows):
        centers, widths, heights = rng.uniform(0, np.pi, 3), rng.uniform(0.05, 0.6, 3), rng.uniform(0.1, 2, 3)
        density = (heights * np.exp(-0.5 * ((angle[:, None] - centers) / widths) ** 2)).sum(axis=1)
        density[rng.integers(knots - 3) :][:3] = 0.0
        table.append(tuple(map(float, density)))
    return tuple(table)


def tabulated(parameters: FiberScatteringParameters, lobes: str, rows: int, knots: int):
    """The same with tables around the fiber for some of its lobes, "r tt trt"."""
    tables = {f"azimuthal_table_{lobe}": humps(rows, knots, seed=i) for i, lobe in enumerate(lobes.split())}
    return replace(parameters, **tables)


def tailed(parameters: FiberScatteringParameters, weights, grazing_weights, ratios):
    """The same with tails of R, TT, TRT; None where a lobe has none."""
    values = {}
    for lobe, weight, along, ratio in zip(("r", "tt", "trt"), weights, grazing_weights, ratios, strict=True):
        values |= {
            f"tail_weight_{lobe}": weight,
            f"tail_weight_{lobe}_grazing": along,
            f"tail_ratio_{lobe}": ratio,
        }
    return replace(parameters, **values)


CORNERS = {
    "narrow": gray((0.5, 1.0, 2.0), 2.0, gamma_trt_deg=5.0),
    "wide": gray((60.0, 40.0, 20.0), 300.0, gamma_trt_deg=90.0),
    "narrow in wide": gray((0.5, 60.0, 18.0), 20.0),
    "von Mises": gray((1.0, 10.0, 30.0), 26.0, gamma_trt_deg=60.0, azimuthal="von_mises"),
    "narrow von Mises": gray((6.0, 0.5, 24.0), 2.0, gamma_trt_deg=300.0, azimuthal="von_mises"),
    "vmf": gray((6.0, 12.0, 24.0), 40.0, longitudinal="vmf"),
    "vmf corners": gray((0.5, 60.0, 2.0), 80.0, longitudinal="vmf", azimuthal="von_mises"),
    "symmetric": gray((2.0, 12.0, 40.0), 40.0, longitudinal="symmetric"),
    "symmetric corners": gray(
        (24.0, 0.5, 60.0), 20.0, gamma_trt_deg=80.0, longitudinal="symmetric", azimuthal="von_mises"
    ),
    # wide and grazing: the R lobe has a second mode on the far side
    "symmetric wide": gray((60.0, 40.0, 20.0), 300.0, fresnel_r=0.0, longitudinal="symmetric"),
    "grazing": grazing(gray((3.0, 4.0, 9.0), 30.0, gamma_trt_deg=15.0), (4.0, 9.0, 20.0, 75.0, 90.0), 0.3),
    "grazing corners": grazing(
        gray((0.5, 30.0, 2.0), 2.0, gamma_trt_deg=300.0), (45.0, 15.0, 30.0, 300.0, 20.0), 1.0
    ),
    "grazing von Mises": grazing(
        gray((1.0, 10.0, 30.0), 20.0, gamma_trt_deg=90.0, azimuthal="von_mises"),
        (6.0, 30.0, 15.0, 120.0, 40.0),
    ),
    "grazing vmf": grazing(
        gray((0.5, 12.0, 24.0), 40.0, longitudinal="vmf"), (20.0, 6.0, 45.0, 90.0, None), 0.0
    ),
    "series": gray((3.0, 8.0, 50.0), 81.0, gamma_trt_deg=100.0),
    "table": tabulated(gray((3.0, 4.0, 9.0), 30.0, fresnel_r=0.3), "r tt trt", 1, 33),
    "table rows": tabulated(gray((5.0, 8.0, 20.0), 30.0, gamma_trt_deg=60.0), "r tt trt", 4, 129),
    "table of TRT": tabulated(gray((5.0, 8.0, 20.0), 30.0, longitudinal="vmf"), "trt", 2, 9),
    "table grazing": grazing(
        tabulated(gray((3.0, 4.0, 9.0), 30.0, gamma_trt_deg=60.0, azimuthal="von_mises"), "tt r", 2, 65),
        (4.0, 9.0, 20.0, 75.0, 90.0),
        0.3,
    ),
    "tails": tailed(gray((3.0, 8.0, 20.0), 40.0), (0.9, 0.3, 0.5), (None, 0.9, 0.0), (0.3, 1.5, 2.5)),
    "tails corners": tailed(
        gray((0.5, 60.0, 2.0), 300.0, gamma_trt_deg=20.0, azimuthal="von_mises"),
        (1.0, 0.5, 0.5),
        (1.0, None, 0.1),
        (1.0, 1.5, 0.25),
    ),
    "tail of TT, grazing vmf": tailed(
        grazing(gray((4.0, 2.0, 24.0), 40.0, longitudinal="vmf"), (8.0, 12.0, 45.0, 90.0, None), 0.0),
        (None, 0.6, None),
        (None, 0.1, None),
        (None, 0.5, None),
    ),
    "table symmetric": tabulated(gray((6.0, 12.0, 24.0), 40.0, longitudinal="symmetric"), "r trt", 1, 33),
}
