"""The pictures of `weft scattering`, as figures 6.1 and 6.2 of the thesis: polar slices, and lobes in space.

Loads matplotlib.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from weft.fiber_model.scattering.parameters import FiberScatteringParameters
from weft.fiber_model.scattering.phase import fiber_phase_eval
from weft.files.atomic import atomic_write
from weft.files.errors import InputError

from .lobe_sources import Lobes

Array = NDArray[np.float64]

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
SLICE_POINTS = 1441
SURFACE_POINTS = (181, 241)
LIGHT = np.array([0.3, -0.5, 0.8])


def draw_lobes(lobes: Lobes, path: Path, *, theta_deg: float = 45.0) -> None:
    """Write the PNG. Slices of all sets lie over each other; the lobes in space stand side by side."""
    if not -90 < theta_deg < 90:
        raise InputError(f"theta is {theta_deg:g} deg; it must lie between -90 and 90")
    if path.suffix.lower() != ".png":
        raise InputError("the picture is a .png file", path=path)
    columns = max(2, min(3, len(lobes)))
    rows = -(-len(lobes) // columns)
    figure: Any = Figure(figsize=(4.6 * columns, 5.0 + 4.0 * rows), dpi=100, layout="constrained")
    top, bottom = figure.subfigures(2, 1, height_ratios=[5.0, 4.0 * rows])
    theta_o = np.radians(theta_deg)
    _draw_slices(top, lobes, theta_o)
    for number, (name, parameters) in enumerate(lobes.items(), start=1):
        axes = bottom.add_subplot(rows, columns, number, projection="3d")
        _draw_lobe(axes, name, parameters, theta_o)
    with atomic_write(path) as temporary, temporary.open("wb") as file:
        FigureCanvasAgg(figure).print_png(file)


def _draw_slices(figure: Any, lobes: Lobes, theta_o: float) -> None:
    """Luminance of f_p [1/sr] in the plane of the light and the fiber, and on the specular cone around it."""
    along, around = figure.subplots(1, 2, subplot_kw={"projection": "polar"})
    angle = np.linspace(-np.pi, np.pi, SLICE_POINTS)
    wo = _direction(theta_o, 0.0)
    in_plane = np.stack([np.sin(angle), np.cos(angle), np.zeros_like(angle)], axis=-1)
    for name, parameters in lobes.items():
        along.plot(angle, fiber_phase_eval(parameters, wo, in_plane) @ LUMINANCE, label=name, lw=1.4)
        around.plot(angle, fiber_phase_eval(parameters, wo, _direction(-theta_o, angle)) @ LUMINANCE, lw=1.4)
    along.set_title(
        "along the fiber: wi in the plane of wo and the fiber\n(up: across, on the side of the light)"
    )
    around.set_title("around the fiber: wi on the specular cone\n(up: azimuth of the light)")
    for axes, toward in ((along, theta_o), (around, 0.0)):
        axes.set_theta_zero_location("N")
        axes.set_theta_direction(-1)
        axes.tick_params(labelsize=8)
        reach = axes.get_rmax()
        axes.plot([toward, toward], [0, reach], color="gray", lw=1, ls="--", label="wo")
        axes.set_rmax(reach)
    figure.legend(*along.get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=9)


def _draw_lobe(axes: Any, name: str, parameters: FiberScatteringParameters, theta_o: float) -> None:
    """The surface at distance f_p (luminance) from the origin, in the color of the light."""
    theta = np.linspace(-np.pi / 2, np.pi / 2, SURFACE_POINTS[0])[:, None]
    phi = np.linspace(0, 2 * np.pi, SURFACE_POINTS[1])
    wi = _direction(theta, phi)
    value = fiber_phase_eval(parameters, _direction(theta_o, 0.0), wi)
    radius = value @ LUMINANCE
    reach = max(float(radius.max()), 1e-12)
    x, y, z = np.moveaxis(wi * (radius / reach)[..., None], -1, 0)
    axes.plot_surface(
        x, z, y, facecolors=_shaded(value, x, y, z), rcount=181, ccount=241, linewidth=0, antialiased=False
    )
    axes.plot([-1, 1], [0, 0], [0, 0], color="black", lw=2.5)
    ox, oy, _ = _direction(theta_o, 0.0)
    axes.plot([0, ox], [0, 0], [0, oy], color="tab:orange", lw=1.5, ls="--")
    axes.set_title(f"{name}\nlargest f_p = {reach:.3g} / sr", fontsize=10, y=0.98)
    axes.set(xlim=(-0.75, 0.75), ylim=(-0.75, 0.75), zlim=(-0.75, 0.75))
    axes.set_box_aspect((1, 1, 1), zoom=1.15)
    axes.view_init(elev=14, azim=-66)
    axes.set_axis_off()


def _shaded(value: Array, x: Array, y: Array, z: Array) -> Array:
    """Colors [..., 4] of the surface's points: the hue of f_p, sRGB, lit from the side."""
    hue = value / np.maximum(value.max(axis=-1, keepdims=True), 1e-12)
    points = np.stack([x, z, y], axis=-1)
    normal = np.cross(np.gradient(points, axis=1), np.gradient(points, axis=0))
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
    light = 0.35 + 0.65 * np.abs(normal @ (LIGHT / np.linalg.norm(LIGHT)))
    color = np.clip(hue * light[..., None], 0, 1) ** (1 / 2.2)
    return np.concatenate([color, np.ones_like(color[..., :1])], axis=-1)


def _direction(theta: Any, phi: Any) -> Array:
    """Unit vectors at inclination theta and azimuth phi around the fiber x; the light's azimuth is 0."""
    theta, phi = np.broadcast_arrays(np.asarray(theta, float), np.asarray(phi, float))
    return np.stack([np.sin(theta), np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi)], axis=-1)
