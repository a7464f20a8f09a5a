"""Small meshes as files, and rays against them in float64."""

from __future__ import annotations

from pathlib import Path

import numpy as np


def write_ball(folder: Path, *, name: str = "ball.obj", subdivisions: int = 2, radius: float = 1.0) -> Path:
    import trimesh

    trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius).export(folder / name)
    return folder / name


def first_hits(corners: np.ndarray, origins: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Distances of parallel rays to the nearest of all triangles, infinite where there is none."""
    e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    p = np.cross(direction, e2)
    s = origins[:, None] - corners[None, :, 0]
    scale = 1 / (e1 * p).sum(-1)
    q = np.cross(s, e1)
    b1, b2, t = (s * p).sum(-1) * scale, (q @ direction) * scale, (q * e2).sum(-1) * scale
    meets = (b1 >= 0) & (b2 >= 0) & (b1 + b2 <= 1) & (t > 0)
    return np.where(meets, t, np.inf).min(axis=1)
