"""Draws the pictures of fiber_model/optics/README.md: `python tests/fiber_model/optics/draw_pictures.py`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from weft.fiber_model.optics.cross_sections import build_outline
from weft.fiber_model.optics.dielectric import fresnel
from weft.fiber_model.optics.light_transport import run
from weft.fiber_model.optics.materials import MATERIALS, FiberMaterial, material_optics
from weft.fiber_model.optics.outline import Outline

Array = NDArray[np.float64]

FOLDER = Path(__file__).resolve().parents[3] / "fiber_model" / "optics" / "pictures"
COLORS = ("#1f5fa8", "#c8682c", "#4c8c4a")
INCLINATIONS_DEG = (0, 60)
PATHS = 1_000_000
RAYS = 11
FAINTEST = 0.02
"""Part of a ray's light below which it is not drawn further."""


def main() -> None:
    import matplotlib

    matplotlib.use("Agg")
    matplotlib.rcParams |= {"font.size": 8, "savefig.dpi": 90}
    draw_cross_sections(FOLDER / "cross_sections.png")
    draw_azimuthal_scattering(FOLDER / "azimuthal.png")


def draw_cross_sections(path: Path) -> None:
    """Each outline at one scale, with rays of light from the left, as faint as what is left of them."""
    from matplotlib import pyplot as plt

    each = [(material, name) for material in MATERIALS.values() for name in material.cross_sections]
    figure, axes = plt.subplots(3, 5, figsize=(12, 6.6))
    for axis in axes.flat[len(each) :]:
        axis.axis("off")
    for axis, (material, name) in zip(axes.flat, each, strict=False):
        outline = build_outline(material.cross_sections[name])
        points = 1e3 * outline.points(65)
        axis.fill(*points.T, facecolor="#f2ead8", edgecolor="#5a4a2a", linewidth=1.0)
        half = 0.98 * np.abs(outline.points()[:, 1]).max()
        for height in np.linspace(-half, half, RAYS):
            for start, end, light in _rays(outline, material.refractive_index, float(height)):
                axis.plot(*(1e3 * np.array([start, end])).T, color="#c03030", linewidth=0.7, alpha=light**0.5)
        axis.set(xlim=(-19, 19), ylim=(-15, 15), aspect="equal", xticks=[], yticks=[])
        axis.set_title(f"{material.name}: {name}, n = {material.refractive_index:.3f}")
        axis.plot([8, 18], [-13.5, -13.5], color="black", linewidth=2)
        axis.text(13, -13, "10 µm", ha="center", va="bottom")
    figure.tight_layout()
    _save(figure, path)


def _rays(outline: Outline, index: float, height: float) -> Iterator[tuple[Array, Array, float]]:
    """Pieces of ray with the light that each carries, in the normal plane of a smooth fiber."""
    pending = [(np.array([-0.022, height]), np.array([1.0, 0.0]), False, -1, 1.0)]
    while pending:
        origin, along, inside, last, light = pending.pop()
        arc, distance = _nearest(outline, origin, along, last)
        if arc < 0:
            yield origin, origin + 0.06 * along, light
            continue
        place = origin + distance * along
        yield origin, place, light
        left = np.array([-outline.start_tangents[arc, 1], outline.start_tangents[arc, 0]])
        normal = outline.curvatures[arc] * (place - outline.starts[arc]) - left
        normal *= -np.sign(normal @ along)
        eta = 1 / index if inside else index
        cosine = -float(normal @ along)
        reflected = float(fresnel(cosine, eta))
        ways = [(along + 2 * cosine * normal, inside, light * reflected)]
        if reflected < 1:
            bend = cosine / eta - np.sqrt(1 - (1 - cosine**2) / eta**2)
            ways.append((along / eta + bend * normal, not inside, light * (1 - reflected)))
        pending += [(place, way, within, arc, left) for way, within, left in ways if left > FAINTEST]


def _nearest(outline: Outline, origin: Array, along: Array, last: int) -> tuple[int, float]:
    """Both roots of every arc, in numpy: nothing shared with the kernel but the equation of an arc."""
    left = np.stack([-outline.start_tangents[:, 1], outline.start_tangents[:, 0]], axis=1)
    offset = origin - outline.starts
    k = np.where(np.abs(outline.curvatures) < 1e-6, 1e-6, outline.curvatures)
    b = k * (offset @ along) - left @ along
    c = k * (offset**2).sum(axis=1) - 2 * (offset * left).sum(axis=1)
    root = np.sqrt(np.maximum(b**2 - k * c, 0))
    best, distance = -1, np.inf
    for t in ((-b - root) / k, (-b + root) / k):
        place = origin + t[:, None] * along
        on = ((place - outline.starts) * outline.start_tangents).sum(axis=1) >= 0
        on &= ((place - outline.ends) * outline.end_tangents).sum(axis=1) <= 0
        on &= (b**2 > k * c) & (t > np.where(np.arange(len(t)) == last, 1e-6, 1e-12)) & (t < distance)
        for arc in np.flatnonzero(on):
            if t[arc] < distance:
                best, distance = int(arc), float(t[arc])
    return best, distance


def draw_azimuthal_scattering(path: Path) -> None:
    """f_p summed over inclinations, against azimuth; the light comes from the right. Radius: cube root."""
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(2, 6, figsize=(14, 5.8), subplot_kw={"projection": "polar"})
    for column, material in enumerate(MATERIALS.values()):
        for row, theta in enumerate(INCLINATIONS_DEG):
            _draw_material(axes[row, column], material, theta)
    figure.tight_layout()
    _save(figure, path)


def _draw_material(axis: Any, material: FiberMaterial, theta_deg: int) -> None:
    for color, shape in zip(COLORS, material.cross_sections, strict=False):
        settings = {"paths": PATHS, "theta_i_deg": (theta_deg,), "phi_bin_deg": 5}
        result = run(material_optics(material.name, shape, **settings))
        density = (result.phase_function()[0, ..., 1] * result.bins.solid_angles).sum(axis=0)
        density /= np.radians(5)
        phi = np.append(result.bins.phi, result.bins.phi[0])
        axis.plot(phi, np.cbrt(np.append(density, density[0])), color=color, linewidth=1.1, label=shape)
    marks = (0.01, 0.1, 0.3)
    axis.set(ylim=(0, 0.95), xticks=np.radians([0, 90, 180, 270]))
    axis.set_yticks(np.cbrt(marks), [f"{mark:g}" for mark in marks], fontsize=6)
    axis.set_title(f"{material.name}, light at {theta_deg}°")
    if theta_deg == INCLINATIONS_DEG[0]:
        axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), fontsize=7, frameon=False)


def _save(figure: Any, path: Path) -> None:
    """As a PNG of 200 colors."""
    from matplotlib import pyplot as plt
    from PIL import Image

    figure.savefig(path)
    plt.close(figure)
    with Image.open(path) as image:
        small = image.convert("RGB").quantize(200)
    small.save(path, optimize=True)


if __name__ == "__main__":
    main()
