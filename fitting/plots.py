"""Pictures of a fit: polar slices of data and model as in thesis figure 6.1, and a map of the residuals."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from weft.files.atomic import atomic_write

from .measurements import Measurements
from .result import FitResult

SLICE_WIDTH_DEG = 6.0
"""A datum within this of the plane belongs to the polar slice."""


def write_plots(result: FitResult, slices: Path, residuals: Path) -> None:
    from matplotlib.figure import Figure

    for path, draw in ((slices, _draw_slices), (residuals, _draw_residuals)):
        figure = Figure(figsize=(11, 4.2 * (1 if draw is _draw_residuals else 2)), layout="constrained")
        draw(figure, result)
        with atomic_write(path) as temporary:
            figure.savefig(temporary, dpi=100, metadata={"Software": None})


def _lights(measurements: Measurements) -> NDArray[np.float64]:
    return np.unique(np.round(np.degrees(measurements.theta_i), 4)).astype(np.float64)[:4]


def _draw_slices(figure: Any, result: FitResult) -> None:
    """Above: in the plane of light and fiber; below: around the fiber on the specular cone."""
    lights = _lights(result.seen)
    axes = figure.subplots(2, len(lights), subplot_kw={"projection": "polar"}, squeeze=False)
    for column, light in enumerate(lights):
        along, around = _slice_along(result.seen, light), _slice_around(result.seen, light)
        for row, (angle, chosen) in enumerate((along, around)):
            _polar(axes[row, column], angle, result.seen.values[chosen], result.model[chosen])
        axes[0, column].set_title(f"light at {light:g}°, along the fiber", fontsize=9)
        axes[1, column].set_title("around it, on the specular cone", fontsize=9)


def _slice_along(data: Measurements, light: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    phi = _azimuth(data)
    at = np.abs(np.degrees(data.theta_i) - light) < 1e-3
    near = np.minimum(np.abs(phi), np.pi - np.abs(phi)) < np.radians(SLICE_WIDTH_DEG)
    chosen = np.flatnonzero(at & near)
    theta = data.theta_o[chosen]
    angle = np.where(np.abs(phi[chosen]) < np.pi / 2, theta, np.pi - theta)
    order = np.argsort(angle, kind="stable")
    return angle[order], chosen[order]


def _slice_around(data: Measurements, light: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    at = np.abs(np.degrees(data.theta_i) - light) < 1e-3
    gap = np.where(at, np.abs(data.theta_o + data.theta_i), np.inf)
    chosen = np.flatnonzero(gap <= gap.min() + 1e-6)
    phi = _azimuth(data)[chosen]
    order = np.argsort(phi, kind="stable")
    return phi[order], chosen[order]


def _azimuth(data: Measurements) -> NDArray[np.float64]:
    phi = data.phi_o - data.phi_i
    return np.asarray(phi - 2 * np.pi * np.round(phi / (2 * np.pi)))


def _polar(axes: Any, angle: NDArray, values: NDArray, model: NDArray) -> None:
    """Cube roots, so that all lobes are seen at once."""
    for channel in range(values.shape[1]):
        color = "black" if values.shape[1] == 1 else "rgb"[channel]
        axes.plot(angle, np.cbrt(np.maximum(values[:, channel], 0)), ".", color=color, markersize=4)
        axes.plot(angle, np.cbrt(model[:, channel]), "-", color=color, linewidth=1)
    axes.tick_params(labelsize=7)


def _draw_residuals(figure: Any, result: FitResult) -> None:
    """(value - model) over the largest value of the light, against azimuth and inclination."""
    lights = _lights(result.seen)
    axes = figure.subplots(1, len(lights), squeeze=False, sharey=True)[0]
    phi, theta = np.degrees(_azimuth(result.seen)), np.degrees(result.seen.theta_o)
    for light, axis in zip(lights, axes, strict=True):
        at = np.abs(np.degrees(result.seen.theta_i) - light) < 1e-3
        peak = np.abs(result.seen.values[at]).max()
        gap = 100 * (result.seen.values - result.model)[at].mean(axis=1) / peak
        limit = max(float(np.quantile(np.abs(gap), 0.99)), 1e-12)
        drawn = axis.scatter(phi[at], theta[at], c=gap, s=5, cmap="RdBu_r", vmin=-limit, vmax=limit)
        axis.set_title(f"light at {light:g}°: % of the peak", fontsize=9)
        axis.set_xlabel("phi [°]")
        figure.colorbar(drawn, ax=axis, shrink=0.8)
    axes[0].set_ylabel("theta_o [°]")
