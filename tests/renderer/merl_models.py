"""MERL tables of analytic models, since no measured file is shipped: matte, metallic paint, satin."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from weft.files.measured.merl import CELLS, SCALE, MerlTable, center_directions, write_merl

Color = tuple[float, float, float]


def table_of(brdf: np.ndarray) -> MerlTable:
    """From the BRDF [1/sr] in every cell, shape [1458000, 3]."""
    return MerlTable(np.ascontiguousarray((brdf / SCALE).T.reshape(3, *CELLS)))


def matte(reflectance: float = 1.0) -> MerlTable:
    """Lambert's law, the same in every cell."""
    return table_of(np.full((int(np.prod(CELLS)), 3), reflectance / np.pi))


def glossy(color: Color, roughness: float, base: Color) -> MerlTable:
    """A matte base under GGX facets, Schlick's reflection from `color` on; nothing below the surface."""
    light, detector = center_directions()
    half = light + detector
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    a2 = roughness**4
    cos_h, cos_d = half[:, 2], (half * light).sum(axis=1)
    facets = a2 / (np.pi * (1 + (a2 - 1) * cos_h**2) ** 2)
    up = np.maximum(np.stack([light[:, 2], detector[:, 2]]), 1e-3)
    shadow = np.prod(up + np.sqrt(a2 + (1 - a2) * up**2), axis=0)
    fresnel = np.array(color) + (1 - np.array(color)) * (np.maximum(1 - cos_d, 0) ** 5)[:, None]
    brdf = fresnel * (facets / shadow)[:, None] + np.array(base) / np.pi
    below = (light[:, 2] <= 0) | (detector[:, 2] <= 0)
    return table_of(np.where(below[:, None], -1.0, brdf))


def gold_paint() -> MerlTable:
    """About what figure 7.4 of the thesis shows."""
    return glossy((0.55, 0.36, 0.12), 0.42, (0.12, 0.07, 0.02))


def write_model(folder: Path, name: str, table: MerlTable) -> Path:
    file = folder / f"{name}.binary"
    write_merl(table, file)
    return file
