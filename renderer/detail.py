"""Choice of detail: for every brick the coarsest level whose voxels appear no larger than so many pixels.

A brick of level k covers 2^k bricks of the finest along each edge. Larger bricks reach nearer to the camera
and have larger voxels, so where one is fine enough, all within it are: chosen bricks cover each place once.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from weft.voxelize.grid import BRICK_SIZE

from .camera import CameraFrame


@dataclass(frozen=True)
class PixelFootprint:
    """How wide a pixel is at a place of the scene; a lens' blur and distortion aside."""

    perspective: bool
    position: np.ndarray
    forward: np.ndarray
    width: float
    """At distance 1 along the view; of an orthographic camera [mm] everywhere."""
    slant: float
    """Cosine of the angle between the view and a corner of the picture."""

    def narrowest(self, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Width of a pixel where boxes are nearest to the camera [mm], corners [mm] of shape [n, 3]; [n].

        What is seen in the picture at distance r lies at least r times `slant` deep. That bounds the depth
        also for boxes beside and behind the camera, which light passes on its way to what is seen.
        """
        if not self.perspective:
            return np.full(len(low), self.width)
        middle, half = (low + high) / 2 - self.position, (high - low) / 2
        depth = _dot(middle, self.forward) - _dot(half, np.abs(self.forward))
        gap = np.maximum(np.abs(middle) - half, 0)
        return self.width * np.maximum(depth, self.slant * np.sqrt(_dot(gap, gap)))


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Row by row, with bits that do not depend on how many rows there are."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]


def pixel_footprint(frame: CameraFrame, resolution: tuple[int, int]) -> PixelFootprint:
    """Of a camera with so many pixels."""
    right, up = float(np.linalg.norm(frame.right)), float(np.linalg.norm(frame.up))
    return PixelFootprint(
        frame.perspective,
        frame.position,
        frame.forward,
        width=min(2 * right / resolution[0], 2 * up / resolution[1]),
        slant=1 / math.sqrt(1 + right**2 + up**2),
    )


def choose_bricks(
    places: Sequence[np.ndarray], voxel_size_mm: float, footprint: PixelFootprint, pixels: float
) -> list[np.ndarray]:
    """Which bricks of each level are drawn, bool, shape [n] each.

    `places`: per level, finest first, the bricks' origins over 8, integers, shape [n, 3]. A voxel's edge is
    at most `pixels` footprints, but that of the finest, which stand for all that is nearer.
    """
    chosen = []
    for level, bricks in enumerate(places):
        fits = _fine_enough(bricks, level, voxel_size_mm, footprint, pixels)
        if level + 1 < len(places):
            fits &= ~_fine_enough(bricks >> 1, level + 1, voxel_size_mm, footprint, pixels)
        chosen.append(fits)
    return chosen


def _fine_enough(
    places: np.ndarray, level: int, voxel_size_mm: float, footprint: PixelFootprint, pixels: float
) -> np.ndarray:
    if level == 0:
        return np.ones(len(places), bool)
    edge = voxel_size_mm * 2**level
    low = places * (BRICK_SIZE * edge)
    return edge <= pixels * footprint.narrowest(low, low + BRICK_SIZE * edge)
