"""Six textile fibers from physics: shapes, refractive indices, roughness and absorption, with sources.

Refractive indices along and across the fiber: Morton and Hearle, *Physical Properties of Textile Fibres*,
chapter 24 (through a secondary transcription, good to 0.01). Light here sees their mean: unpolarized light
that meets the fiber at a right angle is half polarized along it and half across. At grazing inclinations the
first half sees less of the index along the axis, so there the mean is high, by at most half the difference.

Roughness and absorption are estimates; README.md says how they were made.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from weft.files.errors import InputError

from .config import (
    CircleConfig,
    CrossSectionConfig,
    EllipseConfig,
    FiberOpticsConfig,
    KidneyConfig,
    LobedConfig,
    RoundedTriangleConfig,
)


@dataclass(frozen=True)
class FiberMaterial:
    """A clean, undyed fiber."""

    name: str
    index_along: float
    """Refractive index for light polarized along the fiber."""
    index_across: float
    roughness: float
    """GGX alpha; an estimate."""
    absorption_per_mm: tuple[float, float, float]
    """Red, green, blue; an estimate."""
    cross_sections: dict[str, CrossSectionConfig]
    """By name; the first is the usual one."""
    note: str
    """Where shapes, sizes and roughness come from."""

    @property
    def refractive_index(self) -> float:
        return 0.5 * (self.index_along + self.index_across)


MATERIALS = {
    material.name: material
    for material in (
        FiberMaterial(
            name="cotton",
            index_along=1.578,
            index_across=1.532,
            roughness=0.3,
            absorption_per_mm=(0.10, 0.12, 0.20),
            cross_sections={
                "kidney": KidneyConfig(width_mm=0.018, thickness_mm=0.008, bend_deg=110),
                "ellipse": EllipseConfig(semi_axes_mm=(0.009, 0.004)),
                "circle": CircleConfig(radius_mm=0.006),
            },
            note="1.7 dtex at 1.52 g/cm³; ripe fibers are collapsed tubes (kidney), mercerized ones round. "
            "Ridges 0.5 µm high and apart, at 20 to 30 degrees to the axis (Textile Research Journal 27, "
            "1957, 419): as fine as the light's wavelength, so their slopes count only in part.",
        ),
        FiberMaterial(
            name="wool",
            index_along=1.553,
            index_across=1.542,
            roughness=0.12,
            absorption_per_mm=(0.39, 0.61, 1.4),
            cross_sections={
                "circle": CircleConfig(radius_mm=0.010),
                "ellipse": EllipseConfig(semi_axes_mm=(0.011, 0.0091)),
            },
            note="Fine wool, 20 µm. Scales tilted by 0.1 to 8.6 degrees (Journal of Materials Science 38, "
            "2003, 4541); their common sense, root to tip, is left out.",
        ),
        FiberMaterial(
            name="silk",
            index_along=1.591,
            index_across=1.538,
            roughness=0.08,
            absorption_per_mm=(0.40, 0.51, 1.1),
            cross_sections={
                "rounded_triangle": RoundedTriangleConfig(side_mm=0.016, corner_radius_mm=0.0025),
                "ellipse": EllipseConfig(semi_axes_mm=(0.0066, 0.0047)),
            },
            note="A single degummed brin, 1.3 dtex at 1.33 g/cm³; the smoothest of the natural fibers.",
        ),
        FiberMaterial(
            name="polyester",
            index_along=1.725,
            index_across=1.537,
            roughness=0.06,
            absorption_per_mm=(0.12, 0.12, 0.15),
            cross_sections={
                "circle": CircleConfig(radius_mm=0.0062),
                "trilobal": LobedConfig(radius_mm=0.0061, lobes=3, depth=0.18),
            },
            note="1.7 dtex at 1.38 g/cm³, bright (no titanium dioxide). Melt-spun, smooth. Its double "
            "refraction, 0.19, is the largest of all: one index is a coarse mean.",
        ),
        FiberMaterial(
            name="nylon",
            index_along=1.582,
            index_across=1.519,
            roughness=0.06,
            absorption_per_mm=(0.11, 0.11, 0.16),
            cross_sections={
                "circle": CircleConfig(radius_mm=0.0069),
                "trilobal": LobedConfig(radius_mm=0.0068, lobes=3, depth=0.18),
            },
            note="Nylon 6.6, 1.7 dtex at 1.14 g/cm³, bright. Melt-spun, smooth.",
        ),
        FiberMaterial(
            name="viscose",
            index_along=1.539,
            index_across=1.519,
            roughness=0.08,
            absorption_per_mm=(0.17, 0.20, 0.34),
            cross_sections={
                "serrated": LobedConfig(radius_mm=0.00646, lobes=9, depth=0.1, flatness=0.85),
                "circle": CircleConfig(radius_mm=0.006),
            },
            note="1.7 dtex at 1.52 g/cm³, bright. The serrations run along the fiber and are its shape; what "
            "lies between them is smooth.",
        ),
    )
}


def material_named(name: str) -> FiberMaterial:
    """Raises `InputError` for one that is not there."""
    if name not in MATERIALS:
        raise InputError(f"there is no fiber material '{name}'", hint=f"Known: {', '.join(MATERIALS)}.")
    return MATERIALS[name]


def material_optics(name: str, cross_section: str | None = None, **settings: Any) -> FiberOpticsConfig:
    """What to simulate for a material, with its usual cross-section or the one named; `settings` go on top.

    Raises `InputError` for a material or cross-section that is not there.
    """
    material = material_named(name)
    shapes = material.cross_sections
    shape = cross_section or next(iter(shapes))
    if shape not in shapes:
        raise InputError(f"{name} has no cross-section '{shape}'", hint=f"Known: {', '.join(shapes)}.")
    values: dict[str, Any] = {
        "cross_section": shapes[shape],
        "refractive_index": material.refractive_index,
        "roughness": material.roughness,
        "absorption_per_mm": material.absorption_per_mm,
    }
    return FiberOpticsConfig(**(values | settings))
