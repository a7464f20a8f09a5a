"""A bar of a round length in mm, in the lower right corner; right at every zoom of a parallel camera."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from .overlay import Overlay

MARGIN, THICKNESS = 0.04, 0.008
"""Of the panel's height."""
LONGEST = 0.28
"""Of the panel's width."""


@dataclass(frozen=True)
class BarLength:
    """A bar that stands for `mm` and is `pixels` long."""

    mm: float
    pixels: float

    @property
    def label(self) -> str:
        return f"{self.mm:g} mm"


def bar_length(parallel_scale: float, width: int, height: int) -> BarLength:
    """The longest of 1, 2, 5, 10, ... mm that fits; `parallel_scale` is half the picture's height [mm]."""
    pixels_per_mm = height / (2.0 * parallel_scale)
    longest = LONGEST * width / pixels_per_mm
    power = 10.0 ** math.floor(math.log10(longest))
    mm = next(step * power for step in (5, 2, 1) if step * power <= longest * (1 + 1e-9))
    return BarLength(mm, mm * pixels_per_mm)


class ScaleBar:
    """The bar in one panel; follows the camera, as it is drawn anew before each frame."""

    def __init__(self, renderer: Any, overlay: Overlay) -> None:
        self._renderer = renderer
        self._bar = overlay.rectangle()
        self._label = overlay.text("", anchor="center")
        self.length = BarLength(1.0, 1.0)
        self._place()
        renderer.AddObserver("StartEvent", lambda caller, event: self._place())

    def _place(self) -> None:
        width, height = self._renderer.GetSize()
        if min(width, height) < 1:
            return
        self.length = bar_length(self._renderer.GetActiveCamera().GetParallelScale(), width, height)
        right, bottom = width - MARGIN * height, MARGIN * height
        left = right - self.length.pixels
        self._bar.place(left, bottom, right, bottom + max(THICKNESS * height, 2.0))
        self._label.place(self.length.label, 0.5 * (left + right), bottom + 2.2 * THICKNESS * height)
