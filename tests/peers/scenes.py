"""Blocks of extinction that look a little like yarn, made from a formula."""

from __future__ import annotations

import numpy as np

from tests.peers.mitsuba_volume import VolumeScene


def twisted_yarns(
    voxels: int, *, peak_extinction: float, resolution: int, albedo: float = 0.95
) -> VolumeScene:
    """Two crossing yarns of three twisted plies in a block of `voxels`^3, 1.6 mm wide, seen from the side.

    The extinction is noisy from voxel to voxel, as fibers make it, and empty outside of the plies.
    """
    center = (np.arange(voxels) + 0.5) / voxels
    x, y, z = np.meshgrid(center, center, center, indexing="ij")
    filled = _plies(x, y, z - 0.38, turns=1.5) | _plies(y, x - 0.1, z - 0.68, turns=-2.0)
    noise = np.random.default_rng(7).random(filled.shape) ** 2
    extinction = np.where(filled, peak_extinction * noise, 0.0).astype(np.float32)
    return VolumeScene(
        extinction=extinction,
        voxel_size_mm=1.6 / voxels,
        albedo=albedo,
        camera_position=(1.5, 1.2, 5.0),
        camera_target=(0.8, 0.8, 0.8),
        fov_deg=26.0,
        resolution=resolution,
    )


def yarn_axes(voxels: int) -> np.ndarray:
    """Fiber axes for `twisted_yarns`: along x below, y above, leaning as by a twist; [n, n, n, 3]."""
    center = (np.arange(voxels) + 0.5) / voxels
    x, y, z = np.meshgrid(center, center, center, indexing="ij")
    lean = 0.5 * np.sin(9 * (x + y))
    below = z < 0.53
    axes = np.stack([np.where(below, 1, lean), np.where(below, lean, 1), 0.3 * np.cos(7 * (x - y))], axis=-1)
    return axes / np.linalg.norm(axes, axis=-1, keepdims=True)


def _plies(along: np.ndarray, across: np.ndarray, up: np.ndarray, *, turns: float) -> np.ndarray:
    """Where three round plies lie around the axis across = 0.5, up = 0."""
    inside = np.zeros(along.shape, bool)
    for ply in range(3):
        angle = 2 * np.pi * (turns * along + ply / 3)
        distance = np.hypot(across - 0.5 - 0.08 * np.cos(angle), up - 0.08 * np.sin(angle))
        inside |= distance < 0.07
    return inside
