"""Lights turned together about the vertical axis through a place, as one walks lamps around the cloth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from .camera import rotation
from .config import Light

PLACES = ("position_mm", "target_mm")
DIRECTIONS = ("direction", "up")


def turned_lights(lights: Sequence[Light], degrees: float, middle_mm: np.ndarray) -> tuple[Light, ...]:
    """Counterclockwise seen from above. Lights that belong to the camera stay: turn its axes for them."""
    if degrees == 0:
        return tuple(lights)
    turn = rotation(1, math.radians(degrees))
    return tuple(_turned(light, degrees, turn, np.asarray(middle_mm, np.float64)) for light in lights)


def _turned(light: Light, degrees: float, turn: np.ndarray, middle: np.ndarray) -> Light:
    if getattr(light, "relative_to", "world") == "camera" or light.kind == "studio":
        return light
    changes: dict[str, Any] = {}
    if hasattr(light, "rotation_deg"):
        changes["rotation_deg"] = light.rotation_deg + degrees
    for name in PLACES:
        if (place := getattr(light, name, None)) is not None:
            changes[name] = tuple((middle + turn @ (np.array(place) - middle)).tolist())
    for name in DIRECTIONS:
        if (direction := getattr(light, name, None)) is not None:
            changes[name] = tuple((turn @ np.array(direction)).tolist())
    return light.model_copy(update=changes)
