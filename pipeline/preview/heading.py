"""The lines at the top of a panel: what is shown, what is not, and what the colors mean."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from typing import Any

from .overlay import Overlay
from .scene import Color, Scene

CHARACTER = 0.54
"""Mean width of a character, in font sizes."""
LINE, MARGIN = 1.35, 0.8
"""Distance of lines, and space around them, in font sizes."""
MOST_ENTRIES = 9
NOTE_INK: Color = (125, 60, 20)


def font_pixels(width: int, height: int) -> int:
    """Readable in small panels, not loud in large ones."""
    return max(round(min(width / 60, height / 42)), 9)


class Heading:
    """Kept at the top of its panel when the window changes."""

    def __init__(self, renderer: Any, overlay: Overlay, scene: Scene, width: int) -> None:
        self._renderer, self._font = renderer, overlay.font_pixels
        columns = max(int((width - 2 * MARGIN * self._font) / (CHARACTER * self._font)), 20)
        self._lines = [
            (overlay.text("", bold=True), line) for line in textwrap.wrap(scene.title, columns - 4)
        ]
        for note in scene.notes:
            wrapped = textwrap.wrap(note, columns)
            self._lines += [(overlay.text("", color=NOTE_INK), line) for line in wrapped]
        self._entries = [
            (row, at, overlay.rectangle(color), overlay.text(""), label)
            for row, at, label, color in _flowed(_shortened(scene.legend), columns)
        ]
        self._place()
        renderer.AddObserver("StartEvent", lambda caller, event: self._place())

    @property
    def height(self) -> float:
        """Pixels from the top of the panel."""
        rows = len(self._lines) + 1 + max((row for row, *_ in self._entries), default=-1)
        return rows * LINE * self._font + MARGIN * self._font

    def _place(self) -> None:
        font, top = self._font, self._renderer.GetSize()[1] - MARGIN * self._font
        left = MARGIN * font
        for line, text in self._lines:
            top -= LINE * font
            line.place(text, left, top)
        for row, column, box, line, label in self._entries:
            x, y = left + column * font, top - (row + 1) * LINE * font
            box.place(x, y + 0.1 * font, x + 0.9 * font, y + font)
            line.place(label, x + 1.4 * font, y)


def _flowed(legend: tuple[tuple[str, Color], ...], columns: int) -> Iterator[tuple[int, float, str, Color]]:
    """Row and place in the row [font sizes] of each entry; a row is as wide as `columns` characters."""
    row, at = 0, 0.0
    for label, color in legend:
        wide = 1.4 + CHARACTER * len(label) + 1.2
        if at and at + wide > CHARACTER * columns:
            row, at = row + 1, 0.0
        yield row, at, label, color
        at += wide


def _shortened(legend: tuple[tuple[str, Color], ...]) -> tuple[tuple[str, Color], ...]:
    if len(legend) <= MOST_ENTRIES:
        return legend
    kept = legend[: MOST_ENTRIES - 1]
    return (*kept, (f"and {len(legend) - len(kept)} more; colors repeat after 8", (255, 255, 255)))
