"""Balls without a file, and sheets of them for comparing materials."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from .mesh import Triangles
from .surface_config import BallSurface, GroundSurface, MeshSurface, Surface, SweepSurface, TubeSurface

SUBDIVISIONS = 3
"""Of the icosahedron: 1,280 triangles."""
SingleSurface = MeshSurface | GroundSurface | BallSurface | TubeSurface


def single_surfaces(surfaces: Sequence[Surface]) -> list[SingleSurface]:
    """The surfaces, each sweep as its balls."""
    singles: list[SingleSurface] = []
    for surface in surfaces:
        if isinstance(surface, SweepSurface):
            singles += sweep_balls(surface)
        else:
            singles.append(surface)
    return singles


def sweep_balls(sweep: SweepSurface) -> list[BallSurface]:
    """Row by row, value by value."""
    start, step, row_step = (
        np.array(vector) for vector in (sweep.position_mm, sweep.step_mm, sweep.row_step_mm)
    )
    return [
        BallSurface(
            position_mm=tuple((start + i * step + j * row_step).tolist()),
            radius_mm=sweep.radius_mm,
            material=row.material.model_copy(update={row.parameter: value}),
        )
        for j, row in enumerate(sweep.rows)
        for i, value in enumerate(sweep.values)
    ]


def ball_triangles(surface: BallSurface, material: int) -> Triangles:
    """In the scene [mm]."""
    ball = unit_ball()
    corners = ball.corners * surface.radius_mm + np.array(surface.position_mm)
    return Triangles(corners, ball.normals, ball.uvs, np.full(len(ball), material), np.zeros(len(ball), int))


@lru_cache(maxsize=1)
def unit_ball() -> Triangles:
    """About as large inside and outside of the unit sphere as makes its volume right."""
    import trimesh

    mesh = trimesh.creation.icosphere(subdivisions=SUBDIVISIONS)
    normals = np.asarray(mesh.vertices, np.float64)[mesh.faces]
    scale = (4 / 3 * np.pi / mesh.volume) ** (1 / 3)
    # u around +y, v upward; a triangle keeps to one side of the seam, a pole has its triangle's azimuth
    u = np.arctan2(normals[..., 0], normals[..., 2]) / (2 * np.pi)
    pole = np.hypot(normals[..., 0], normals[..., 2]) < 1e-9
    first = np.where(pole[:, 0], u[:, 1], u[:, 0])[:, None]
    u = first + (u - first + 0.5) % 1 - 0.5
    others = np.where(pole, 0, u).sum(axis=1) / (~pole).sum(axis=1)
    u = np.where(pole, others[:, None], u)
    v = 0.5 + np.arcsin(np.clip(normals[..., 1], -1, 1)) / np.pi
    count = np.zeros(len(normals), int)
    return Triangles(normals * scale, normals, np.stack([u, v], axis=-1), count, count)
