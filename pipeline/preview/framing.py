"""Where a parallel camera stands so that a box fills the panel below the heading, and at which scale."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .scene import View

DIRECTIONS: dict[View, tuple[tuple[float, float, float], tuple[float, float, float]]] = {
    "front": ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0)),
    "top": ((0.0, 1.0, 0.0), (0.0, 0.0, -1.0)),
    "side": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    "iso": ((0.45, 0.5, 0.74), (0.0, 1.0, 0.0)),
}
"""From the scene toward the camera, and up; y is up in cloth that hangs, z is out of cloth that lies."""
BOTTOM, SIDES, RIGHT_OF_BAR = 0.13, 0.04, 0.17
"""Space below for scale bar and axes (of the height), on both sides, and for a color bar (of the width)."""


@dataclass(frozen=True)
class Framing:
    """A parallel camera."""

    position: np.ndarray
    focal_point: np.ndarray
    up: np.ndarray
    parallel_scale: float
    """Half the height of the panel [mm]."""


@dataclass(frozen=True)
class Panel:
    """Size of a panel in pixels and what of it is taken."""

    width: int
    height: int
    heading: float
    """Pixels at the top."""
    color_bar: bool
    furniture: bool = True
    """Whether there is a scale bar below."""

    def free(self) -> tuple[float, float, float, float]:
        """Left, right, bottom and top of the free rectangle, in pixels."""
        right = RIGHT_OF_BAR if self.color_bar else SIDES
        bottom = BOTTOM if self.furniture else SIDES
        top = self.height - min(self.heading + 0.02 * self.height, 0.6 * self.height)
        return SIDES * self.width, (1 - right) * self.width, bottom * self.height, top


def camera_axes(view: View) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unit vectors to the right, up, and toward the camera."""
    toward, up = (np.array(vector) for vector in DIRECTIONS[view])
    toward = toward / np.linalg.norm(toward)
    right = np.cross(up, toward)
    right /= np.linalg.norm(right)
    return right, np.cross(toward, right), toward


def needed_scale(bounds: np.ndarray, view: View, panel: Panel) -> float:
    """The smallest half height of the panel [mm] at which the box fits into its free rectangle."""
    right, up, _ = camera_axes(view)
    low, high = _extent(bounds, right), _extent(bounds, up)
    left_px, right_px, bottom_px, top_px = panel.free()
    mm_per_pixel = max((low[1] - low[0]) / (right_px - left_px), (high[1] - high[0]) / (top_px - bottom_px))
    return max(mm_per_pixel, 1e-9) * panel.height / 2


def framed(bounds: np.ndarray, view: View, panel: Panel, parallel_scale: float) -> Framing:
    """The camera that puts the middle of the box into the middle of the free rectangle."""
    right, up, toward = camera_axes(view)
    mm_per_pixel = 2 * parallel_scale / panel.height
    left_px, right_px, bottom_px, top_px = panel.free()
    off_x = 0.5 * (left_px + right_px) - 0.5 * panel.width
    off_y = 0.5 * (bottom_px + top_px) - 0.5 * panel.height
    focal = bounds.mean(axis=0) - (off_x * right + off_y * up) * mm_per_pixel
    distance = 2 * float(np.linalg.norm(bounds[1] - bounds[0])) + 1.0
    return Framing(focal + distance * toward, focal, up, parallel_scale)


def _extent(bounds: np.ndarray, direction: np.ndarray) -> tuple[float, float]:
    """Lowest and highest coordinate of a box along a direction."""
    ends = bounds * direction
    return float(ends.min(axis=0).sum()), float(ends.max(axis=0).sum())
