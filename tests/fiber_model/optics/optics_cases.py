"""Fibers that several tests shine light on."""

from __future__ import annotations

from typing import Any

from weft.fiber_model.optics.config import (
    CircleConfig,
    CrossSectionConfig,
    EllipseConfig,
    FiberOpticsConfig,
    KidneyConfig,
    LobedConfig,
    PolygonConfig,
    RoundedTriangleConfig,
)

SHAPES: dict[str, CrossSectionConfig] = {
    "circle": CircleConfig(radius_mm=1),
    "ellipse": EllipseConfig(semi_axes_mm=(1, 0.4)),
    "trilobal": LobedConfig(radius_mm=1, lobes=3, depth=0.2),
    "serrated": LobedConfig(radius_mm=1, lobes=9, depth=0.1, flatness=0.85),
    "kidney": KidneyConfig(width_mm=2.4, thickness_mm=0.8, bend_deg=110),
    "triangle": RoundedTriangleConfig(side_mm=1.8, corner_radius_mm=0.2),
    "notched": PolygonConfig(vertices_mm=((0, 0), (1.5, 0), (1.2, 1.0), (0.6, 0.3), (0.1, 1.1))),
}


def fiber(cross_section: str = "circle", **settings: Any) -> FiberOpticsConfig:
    """A clear smooth fiber of index 1.55 lit at a right angle, 100,000 paths; `settings` go on top."""
    usual: dict[str, Any] = {
        "cross_section": SHAPES[cross_section],
        "refractive_index": 1.55,
        "paths": 100_000,
        "theta_i_deg": (0.0,),
        "seed": 11,
    }
    return FiberOpticsConfig(**(usual | settings))
