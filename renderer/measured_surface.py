"""A MERL table as rows for shaders/surface/merl.glsl: what it reflects, and tables to sample it by.

Half vectors are sampled: for each of `VIEWS` angles of view the chance of each of MERL's 90 cells of theta_h,
about in proportion to the light that comes back over it, all azimuths alike; mixed with the cosine law, whose
share is the one with the least second moment.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from weft.files.measured.merl import CELLS, MerlTable, read_merl

from .environment import LUMINANCE
from .lights import alias_table

VIEWS = 64
"""Angles of view with a sampling table of their own, evenly from 0 to 90 degrees."""
AZIMUTHS = 48
"""Half vectors per cell of theta_h by which its chance is reckoned."""
COSINE_SHARES = np.linspace(0.1, 0.9, 9)


@dataclass(frozen=True)
class MeasuredSurface:
    """One table on its way to the device."""

    rows: np.ndarray
    """(BRDF, 0) of each cell, then per view and theta_h (density of h [1/sr], threshold, alias as bits, share
    of the cosine law); float32, shape [CELLS + VIEWS * 90, 4]."""
    albedo: np.ndarray
    """Light sent back of light from above, RGB."""


def read_measured_surface(path: Path) -> MeasuredSurface:
    """Raises `InputError` for what is not a MERL file."""
    return measured_surface(read_merl(path))


def measured_surface(table: MerlTable) -> MeasuredSurface:
    """Cells where nothing was measured reflect nothing, as in `MerlTable.evaluate`."""
    brdf = table.brdf().reshape(-1, 3)
    brdf = np.where((brdf >= 0).all(axis=1, keepdims=True), brdf, 0.0)
    cells = np.zeros((len(brdf), 4), np.float32)
    cells[:, :3] = brdf
    views = (np.arange(VIEWS) + 0.5) / VIEWS * (np.pi / 2)
    sampling = np.concatenate([_sampling_rows(table, theta) for theta in views])
    sent, _, solid, _ = _sent_back(table, views[0])
    albedo = (sent * solid[:, None, None]).sum(axis=(0, 1)) / AZIMUTHS
    return MeasuredSurface(np.concatenate([cells, sampling]), albedo)


def half_angle_edges() -> np.ndarray:
    """Of the cells of theta_h [rad], shape [91]."""
    return (np.arange(CELLS[0] + 1) / CELLS[0]) ** 2 * (np.pi / 2)


def _sampling_rows(table: MerlTable, theta: float) -> np.ndarray:
    """For light that leaves at the angle `theta`, shape [90, 4]."""
    sent, cosine, solid, jacobian = _sent_back(table, theta)
    luminous = sent @ LUMINANCE
    share = luminous.mean(axis=1) * solid
    # nothing comes back: the shares are never used for light, but have to be some
    probability = share / share.sum() if share.sum() > 0 else solid / solid.sum()
    density = probability / solid
    moments = [
        _second_moment(luminous, c * cosine * jacobian / np.pi + (1 - c) * density[:, None], solid)
        for c in COSINE_SHARES
    ]
    threshold, alias = alias_table(probability)
    rows = np.zeros((CELLS[0], 4), np.float32)
    rows[:, 0], rows[:, 1] = density, threshold
    rows[:, 2] = alias.astype(np.uint32).view(np.float32)
    rows[:, 3] = COSINE_SHARES[np.argmin(moments)]
    return rows


def _second_moment(sent: np.ndarray, density: np.ndarray, solid: np.ndarray) -> float:
    """Of the weights, where half vectors have this density; shapes [90, AZIMUTHS] twice, [90]."""
    squared = np.divide(sent**2, density, out=np.zeros_like(sent), where=density > 0)
    return float((squared * solid[:, None]).sum())


def _sent_back(table: MerlTable, theta: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Over half vectors in the middle of each cell: BRDF x cosine x 4 cos(theta_d), shape [90, AZIMUTHS, 3];
    the cosine of the other direction, 0 below the surface; the cells' solid angles [90]; and 4 cos(theta_d).
    """
    edges = half_angle_edges()
    middle = ((np.arange(CELLS[0]) + 0.5) / CELLS[0]) ** 2 * (np.pi / 2)
    azimuth = (np.arange(AZIMUTHS) + 0.5) / AZIMUTHS * 2 * np.pi
    sine = np.sin(middle)[:, None]
    half = np.stack(
        np.broadcast_arrays(sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(middle)[:, None]), axis=-1
    )
    wo = np.array([np.sin(theta), 0.0, np.cos(theta)])
    cos_d = half @ wo
    wi = 2 * cos_d[..., None] * half - wo
    cosine = np.where(cos_d > 0, np.maximum(wi[..., 2], 0), 0)
    flat = wi.reshape(-1, 3)
    value = table.evaluate(flat, np.broadcast_to(wo, flat.shape)).reshape(wi.shape)
    jacobian = 4 * np.maximum(cos_d, 0)
    solid = 2 * np.pi * (np.cos(edges[:-1]) - np.cos(edges[1:]))
    return value * (cosine * jacobian)[..., None], cosine, solid, jacobian
