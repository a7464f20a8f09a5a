"""Reconstruction filters as tables of places, for shaders/film/filter.glsl."""

from __future__ import annotations

import numpy as np

from .config import BoxFilter, GaussianFilter, LanczosFilter

CELLS = 64
QUADRATURE = 1 << 16
"""Intervals of the midpoint rule; the kinks of |filter| cost it less than 1e-8 of the integral."""

KINDS = {"box": 0, "gaussian": 1, "lanczos": 2}
"""PIXEL_FILTER of the shader; 0: samples lie in their pixel and count equally, without any table."""


def filter_uniforms(pixel_filter: BoxFilter | GaussianFilter | LanczosFilter) -> dict[str, object]:
    """Uniforms of the shader; none for a box."""
    if isinstance(pixel_filter, BoxFilter):
        return {}
    radius = pixel_filter.radius_px
    middle = (np.arange(QUADRATURE) + 0.5) / QUADRATURE * 2 * radius - radius
    values = filter_value(pixel_filter, middle)
    integral = values.mean() * 2 * radius
    width = pixel_filter.tau if isinstance(pixel_filter, LanczosFilter) else pixel_filter.sigma_px
    return {
        "filter_edges": equal_chances(np.abs(values), radius).tolist(),
        "filter_shape": (radius, width, _at_radius(pixel_filter), 1 / integral),
    }


def filter_value(pixel_filter: GaussianFilter | LanczosFilter, x: np.ndarray) -> np.ndarray:
    """Along one axis, `x` in pixels from the middle; Pharr, Jakob and Humphreys 2016, section 7.8."""
    inside = np.abs(x) <= pixel_filter.radius_px
    if isinstance(pixel_filter, LanczosFilter):
        return np.where(inside, np.sinc(x) * np.sinc(x / pixel_filter.tau), 0.0)
    bell = np.exp(-0.5 * (x / pixel_filter.sigma_px) ** 2) - _at_radius(pixel_filter)
    return np.where(inside, np.maximum(bell, 0), 0.0)


def equal_chances(density: np.ndarray, radius: float) -> np.ndarray:
    """Edges of CELLS intervals of equal chance under `density` at midpoints of [-radius, radius]; float32."""
    total = np.concatenate([[0.0], np.cumsum(density)])
    places = np.linspace(-radius, radius, len(total))
    edges = np.interp(np.linspace(0, total[-1], CELLS + 1), total, places).astype(np.float32)
    edges[0], edges[-1] = -radius, radius
    return edges


def _at_radius(pixel_filter: GaussianFilter | LanczosFilter) -> float:
    if isinstance(pixel_filter, LanczosFilter):
        return 0.0
    return float(np.exp(-0.5 * (pixel_filter.radius_px / pixel_filter.sigma_px) ** 2))
