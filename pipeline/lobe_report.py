"""The words of `weft scattering`: albedo against angle, and how even the sampler's weights are."""

from __future__ import annotations

from collections.abc import Iterator
from math import degrees

import numpy as np
from numpy.typing import NDArray

from weft.fiber_model.scattering.parameters import FiberScatteringParameters
from weft.fiber_model.scattering.phase import (
    fiber_phase_albedo,
    fiber_phase_sample,
    lobe_energies,
    longitudinal_widths,
)

from .lobe_sources import Lobes

ANGLES_DEG = (0, 15, 30, 45, 60, 75, 85, 89)
SAMPLES = 20_000
ROUNDING = 1e-24
"""Relative variance below which float64 weights are all the same."""

Array = NDArray[np.float64]


def report_lines(lobes: Lobes) -> Iterator[str]:
    for name, parameters in lobes.items():
        yield f"{name}: {_widths(parameters)}"
        yield _row("theta [deg]", [f"{angle}" for angle in ANGLES_DEG])
        energies = lobe_energies(parameters, _directions())
        yield from _color_rows("albedo", fiber_phase_albedo(parameters, _directions()))
        yield from _color_rows("  of it R", energies[:, 0] + energies[:, 3:].sum(axis=1))
        yield from _color_rows("  TT", energies[:, 1])
        yield from _color_rows("  TRT", energies[:, 2])
        variances = [weight_variance(parameters, wo) for wo in _directions()]
        yield _row("variance", ["0" if v < ROUNDING else f"{v:.1e}" for v in variances])
    yield (
        f"variance: of the weight f_p / pdf over {SAMPLES:,} samples, over the squared albedo, "
        "in the channel where it is largest"
    )


def weight_variance(parameters: FiberScatteringParameters, wo: Array) -> float:
    """Relative variance of the sampler's weight, f_p / pdf, for light from `wo`; zero for a gray fiber."""
    u = np.random.default_rng(1).random((SAMPLES, 4))
    _, weight, _ = fiber_phase_sample(parameters, np.broadcast_to(wo, (SAMPLES, 3)), u)
    albedo = fiber_phase_albedo(parameters, wo)
    lit = albedo > 0
    return float((weight.var(axis=0)[lit] / albedo[lit] ** 2).max(initial=0.0))


def _directions() -> Array:
    theta = np.radians(ANGLES_DEG)
    return np.stack([np.sin(theta), np.cos(theta), np.zeros_like(theta)], axis=-1)


def _widths(parameters: FiberScatteringParameters) -> str:
    along = ", ".join(f"{degrees(beta):.4g}" for beta in longitudinal_widths(parameters))
    around_trt = parameters.azimuthal_width_trt
    trt = "uniform" if around_trt is None else f"{degrees(around_trt):.4g} deg"
    return (
        f"{parameters.longitudinal}, beta R, TT, TRT = {along} deg; {parameters.azimuthal}, "
        f"gamma TT = {degrees(parameters.azimuthal_width_tt):.4g} deg, TRT = {trt}"
    )


def _color_rows(name: str, colors: Array) -> Iterator[str]:
    """One row for a gray quantity, else one for each channel; `colors` [angles, 3]."""
    if np.ptp(colors, axis=1).max() < 1e-12:
        yield _row(name, [f"{value:.4f}" for value in colors[:, 0]])
        return
    for channel, values in zip("rgb", colors.T, strict=True):
        yield _row(f"{name} {channel}", [f"{value:.4f}" for value in values])


def _row(name: str, cells: list[str]) -> str:
    return f"  {name:<12}" + "".join(f"{cell:>9}" for cell in cells)
