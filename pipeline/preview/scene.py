"""What a preview shows, as plain arrays: built without any graphics library, drawn by plotter.py."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

View = Literal["front", "top", "side", "iso"]
Color = tuple[int, int, int]

PALETTE: tuple[Color, ...] = (
    (0, 114, 178),
    (230, 159, 0),
    (0, 158, 115),
    (204, 121, 167),
    (86, 180, 233),
    (150, 130, 20),
    (120, 94, 170),
    (140, 86, 60),
)
"""For yarn types, plies and media: told apart by color-blind eyes too (Okabe and Ito 2008, extended)."""
LOOP_COLOR: Color = (213, 43, 0)
HAIR_COLOR: Color = (40, 40, 40)
DIRECTION_COLORS: tuple[Color, ...] = ((0, 60, 160), (0, 0, 0), (0, 130, 80), (150, 0, 130))
"""For the directions of each medium, on the yellows and browns of density."""


def palette_color(index: int) -> Color:
    """The color of a yarn type, ply or medium; they repeat after eight."""
    return PALETTE[index % len(PALETTE)]


def direction_color(index: int) -> Color:
    """The color of a medium's directions; they repeat after four."""
    return DIRECTION_COLORS[index % len(DIRECTION_COLORS)]


@dataclass(frozen=True)
class Tubes:
    """Polylines drawn as round tubes; curve i has the points offsets[i] to offsets[i + 1]."""

    points: np.ndarray
    """[mm], float32, shape [point_count, 3]; neighbors in a curve differ."""
    offsets: np.ndarray
    """int64, shape [curve_count + 1]."""
    radius: np.ndarray
    """Of each curve [mm], float32, shape [curve_count]."""
    color: np.ndarray
    """Of each point, uint8, shape [point_count, 3]."""
    sides: int

    @property
    def curve_count(self) -> int:
        return len(self.offsets) - 1


@dataclass(frozen=True)
class Slice:
    """Density in a plane across one axis; zero is drawn as empty."""

    axis: int
    position_mm: float
    values: np.ndarray
    """float32, shape [cells along the first other axis, cells along the second]."""
    low_mm: np.ndarray
    """Where the cells begin on the two other axes."""
    cell_mm: float
    top: float
    """Density of the last color; larger ones have it too."""


@dataclass(frozen=True)
class Axes:
    """Directions without heads: a fiber's axis points both ways."""

    centers: np.ndarray
    """[mm], float32, shape [n, 3]."""
    directions: np.ndarray
    """Unit, float32, shape [n, 3]."""
    length_mm: float
    color: np.ndarray
    """uint8, shape [n, 3]."""


@dataclass(frozen=True)
class Surface:
    """The surface where a density passes `level`."""

    values: np.ndarray
    """At cell centers, float32, shape [nx, ny, nz]."""
    low_mm: np.ndarray
    """Where the cells begin."""
    cell_mm: float
    level: float
    color: Color


@dataclass(frozen=True)
class Triangles:
    """A mesh, such as a garment."""

    points: np.ndarray
    """[mm], shape [n, 3]."""
    faces: np.ndarray
    """int, shape [face_count, 3]."""


@dataclass(frozen=True)
class Picture:
    """A picture as it is, one unit of the scene per pixel."""

    levels: np.ndarray
    """sRGB, uint8, shape [height, width, 3]."""


Layer = Tubes | Slice | Axes | Surface | Triangles | Picture


@dataclass(frozen=True)
class Scene:
    """One panel of a preview."""

    kind: str
    """Panels of one kind are drawn at one scale."""
    title: str
    """What is shown, with counts and lengths."""
    layers: tuple[Layer, ...]
    bounds: np.ndarray
    """Lowest and highest corner of what is shown [mm], shape [2, 3]."""
    notes: tuple[str, ...] = ()
    """What is not shown, or differs from the file."""
    legend: tuple[tuple[str, Color], ...] = ()
    frame: np.ndarray | None = None
    """Corners of a box to outline [mm], shape [2, 3]."""
    view: View = "front"
    """Where to look from, unless asked otherwise."""
    in_mm: bool = True
    """Whether a scale bar and axes make sense."""


def size_text(bounds: np.ndarray) -> str:
    """The extent of a box, such as `42 x 41.5 x 3.1 mm`."""
    return " x ".join(f"{extent:.3g}" for extent in bounds[1] - bounds[0]) + " mm"


def length_text(length_mm: float) -> str:
    """Millimeters, meters or kilometers, with three digits."""
    for unit, size in (("km", 1e6), ("m", 1e3)):
        if length_mm >= size:
            return f"{length_mm / size:.3g} {unit}"
    return f"{length_mm:.3g} mm"


def count_text(number: int, what: str) -> str:
    """`1 yarn`, `2,000 yarns`."""
    return f"{number:,} {what}{'s' * (number != 1)}"
