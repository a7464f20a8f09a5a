"""What can be asked of a preview, and how its options are written."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from weft.files.errors import InputError

if TYPE_CHECKING:
    from weft.pipeline.commands.options import LookOptions, UnitOptions

Part = Literal["yarns", "fibers", "grid"]
MAX_SIDE = 4096
MOST_MM = 1e7
NUMBER = r"[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?"


@dataclass(frozen=True)
class SlicePlane:
    """A plane across an axis, through `position_mm`."""

    axis: int
    position_mm: float


@dataclass(frozen=True)
class PreviewOptions:
    """What to show of a file, and how."""

    part: Part | None = None
    slices: tuple[SlicePlane, ...] = ()
    surface: float | None = None
    """Volume fraction at which to draw the grid's surface."""
    box_mm: np.ndarray | None = None
    """Lower and upper corner, shape [2, 3]."""
    scale_to_mm: float | None = None
    radius_mm: float | None = None
    up_axis: Literal["y", "z"] | None = None
    """Axis that points up in a file that does not say; y where not given."""
    frame: int | None = None
    """Time code of a .usd file."""
    exposure: float = 0.0
    """Stops by which a picture is brightened."""

    def __post_init__(self) -> None:
        for option, value in (("--scale-to-mm", self.scale_to_mm), ("--radius-mm", self.radius_mm)):
            if value is not None and not 0 < value <= MOST_MM:
                raise InputError(
                    f"{option}: {value:g} is no length; need a number above 0, up to {MOST_MM:g}"
                )


def preview_options(look: LookOptions, units: UnitOptions) -> PreviewOptions:
    """From the command line's words."""
    return PreviewOptions(
        part=look.part,
        slices=tuple(parse_slice(text) for text in look.slice),
        surface=look.surface,
        box_mm=parse_box(look.box),
        exposure=look.exposure,
        **vars(units),
    )


def parse_slice(text: str) -> SlicePlane:
    """`z=0.5`, in mm."""
    match = re.fullmatch(rf"([xyz])=({NUMBER})", text.strip(), re.IGNORECASE)
    if match is None:
        raise InputError(f"--slice: '{text}' is no plane; write an axis and a place in mm, such as z=0.5")
    return SlicePlane("xyz".index(match[1].lower()), float(match[2]))


def parse_box(text: str | None) -> np.ndarray | None:
    """`x0,y0,z0,x1,y1,z1`, in mm."""
    if text is None:
        return None
    words = text.split(",")
    if len(words) != 6 or not all(re.fullmatch(NUMBER, word.strip(), re.IGNORECASE) for word in words):
        raise InputError(f"--box: '{text}' is no box; write x0,y0,z0,x1,y1,z1 in mm")
    box = np.array([float(word) for word in words]).reshape(2, 3)
    if not (np.isfinite(box).all() and (box[0] < box[1]).all()):
        raise InputError(f"--box: the first corner of '{text}' must lie below the second on every axis")
    return box


def parse_size(text: str | None, panels: int) -> tuple[int, int]:
    """`1280x960`, in pixels. By default a panel is 1280 x 960, several are 720 x 720 each."""
    if text is None:
        return (1280, 960) if panels == 1 else (720 * panels, 720)
    match = re.fullmatch(r"(\d{1,6})\s*[xX×]\s*(\d{1,6})", text.strip())
    if match is None:
        raise InputError(f"--size: '{text}' is no size; write pixels such as 1280x960")
    width, height = int(match[1]), int(match[2])
    if min(width // panels, height) < 160 or max(width, height) > MAX_SIDE:
        raise InputError(f"--size: {text} is out of range; 160 (for each panel) to {MAX_SIDE} pixels")
    return width, height
