"""Built-in garments with surface coordinates in mm of flat cloth: a sleeve and a scarf, both with folds."""

from __future__ import annotations

import numpy as np

from .surface_mesh import SurfaceMesh

SAMPLES_PER_STEP = 8
"""Quadrature points per mesh row, for lengths along a curve."""


def sleeve_mesh(
    *,
    length_mm: float,
    cuff_girth_mm: float,
    top_girth_mm: float,
    fold_count: float = 3.0,
    fold_depth_mm: float = 0.0,
    step_mm: float = 2.0,
) -> SurfaceMesh:
    """A sleeve around the y axis, cuff down, with folds at the elbow that gather on its +z side.

    u runs around it, v up along it, as long as the cloth is: every meridian keeps its length, so the folded
    side becomes shorter. Around, the cloth is flat at the mean of both girths and stretches from there. Its
    seam lies at the back (-z).
    """
    girth = 0.5 * (cuff_girth_mm + top_girth_mm)
    around = max(int(np.ceil(girth / step_mm)), 12)
    along = max(int(np.ceil(length_mm / step_mm)), 4)
    v = np.linspace(0.0, length_mm, along * SAMPLES_PER_STEP + 1)
    angle = 2 * np.pi * np.arange(around) / around  # 0 at the back
    radius = _sleeve_radius(v, angle, length_mm, cuff_girth_mm, top_girth_mm, fold_count, fold_depth_mm)
    slope = np.gradient(radius, v, axis=0)
    rise = np.sqrt(np.clip(1.0 - slope**2, 0.05, None))
    y = np.concatenate([np.zeros((1, around)), np.cumsum(0.5 * (rise[1:] + rise[:-1]), axis=0)])
    y = y * (v[1] - v[0])
    y -= 0.5 * (y[0] + y[-1])  # the middle rows stay level: folds shorten both halves
    rows = slice(None, None, SAMPLES_PER_STEP)
    position = np.stack([-radius * np.sin(angle), y, -radius * np.cos(angle)], axis=2)[rows]
    u = np.linspace(0.0, girth, around + 1)
    return _grid_mesh(position, u, v[rows], wraps=True)


def _sleeve_radius(
    v: np.ndarray,
    angle: np.ndarray,
    length: float,
    cuff: float,
    top: float,
    fold_count: float,
    fold_depth: float,
) -> np.ndarray:
    """Distance from the axis [mm], shape [v, angle]: a cone, and folds that slant around the elbow."""
    t = v[:, None] / length
    cone = (cuff + (top - cuff) * t) / (2 * np.pi)
    near_elbow = np.exp(-(((t - 0.5) / 0.22) ** 2))
    inside = 0.5 * (1.0 - np.cos(angle))  # 1 on the +z side
    wave = np.cos(2 * np.pi * fold_count * (t - 0.5) / 0.6 + 0.9 * np.sin(angle))
    return cone + 0.5 * fold_depth * near_elbow * inside * wave


def scarf_mesh(
    *,
    width_mm: float,
    length_mm: float,
    fold_count: float = 3.0,
    fold_depth_mm: float = 0.0,
    rail_radius_mm: float = 0.0,
    front_share: float = 0.55,
    step_mm: float = 2.0,
) -> SurfaceMesh:
    """A scarf that hangs along y in pleats toward +z. Pleats bend it and stretch it nowhere, but for a rail:
    there they fade out over a third of what hangs, and the cloth is gathered below.
    """
    across = max(int(np.ceil(width_mm / step_mm)), 4)
    along = max(int(np.ceil(length_mm / step_mm)), 4)
    u = np.linspace(0.0, width_mm, across * SAMPLES_PER_STEP + 1)
    wave = 2 * np.pi * fold_count / width_mm
    slope = np.clip(-0.5 * fold_depth_mm * wave * np.sin(wave * u), -0.98, 0.98)
    x, z = _integral(np.sqrt(1 - slope**2), u), _integral(slope, u)
    v = np.linspace(0.0, length_mm, along + 1)
    columns = slice(None, None, SAMPLES_PER_STEP)
    x, z, u = x[columns], z[columns], u[columns]
    x, z = x - 0.5 * (x[0] + x[-1]), z - z.mean()
    if rail_radius_mm > 0:
        flat = u - 0.5 * width_mm
        places = _over_rail(x, z, flat, front_share * length_mm - v, rail_radius_mm)
        return _grid_mesh(places, u, v, wraps=False)
    shape = (len(v), len(u))
    position = np.stack(
        [
            np.broadcast_to(x, shape),
            np.broadcast_to(v[:, None] - 0.5 * length_mm, shape),
            np.broadcast_to(z, shape),
        ],
        axis=2,
    )
    return _grid_mesh(position, u, v, wraps=False)


def _over_rail(x: np.ndarray, z: np.ndarray, flat: np.ndarray, s: np.ndarray, radius: float) -> np.ndarray:
    """Places of a scarf over a rail around the x axis, shape [s, u, 3].

    `x`, `z`: the pleated section; `flat`: where the same threads lie on the rail; `s`: length of cloth from
    the top of the rail, toward the back where negative.
    """
    quarter = 0.5 * np.pi * radius
    hang = np.maximum(np.abs(s) - quarter, 0.0)
    angle = np.clip(s, -quarter, quarter) / radius
    t = np.clip(hang / (0.35 * np.abs(s).max()), 0.0, 1.0)
    share = (t * t * (3 - 2 * t))[:, None]
    toward = np.stack([np.zeros_like(s), np.cos(angle), np.sin(angle)], axis=1)
    position = radius * toward + hang[:, None] * np.array([0.0, -1.0, 0.0])
    across = share * x + (1 - share) * flat
    lift = share * (z - z.min())  # away from the rail, so that front and back do not meet
    out = position[:, None] + lift[..., None] * toward[:, None]
    return out + across[..., None] * np.array([1.0, 0.0, 0.0])


def _integral(values: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Integral from the first place to each, by trapezoids."""
    return np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(x))])


def _grid_mesh(position: np.ndarray, u: np.ndarray, v: np.ndarray, *, wraps: bool) -> SurfaceMesh:
    """Triangles over a grid of positions, shape [v, u, 3]; with `wraps` the last column meets the first."""
    rows, columns = position.shape[:2]
    cells = columns if wraps else columns - 1
    i, j = (index.reshape(-1) for index in np.meshgrid(np.arange(rows - 1), np.arange(cells), indexing="ij"))
    corners = [(i, j), (i, j + 1), (i + 1, j + 1), (i + 1, j)]
    vertex = [row * columns + column % columns for row, column in corners]
    uv = [np.stack([u[column], v[row]], axis=1) for row, column in corners]
    halves = [(0, 1, 2), (0, 2, 3)]
    faces = np.concatenate([np.stack([vertex[k] for k in half], axis=1) for half in halves])
    corner_uv = np.concatenate([np.stack([uv[k] for k in half], axis=1) for half in halves])
    return SurfaceMesh.checked(position.reshape(-1, 3), faces, corner_uv, uv_unit_mm=1.0)
