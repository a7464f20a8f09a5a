"""Lights turned together about the vertical axis through a place, as one walks lamps around the cloth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from .camera import rotation
from .config import Light
from .light_config import MeshLight
from .surface_config import Placement

OF_THE_CAMERA = ("studio", "softbox")
PLACES = ("position_mm", "target_mm")
DIRECTIONS = ("direction", "up")
ANGLES = ("rotation_deg", "sun_azimuth_deg")
"""Keys of lights that say where they are, which way they shine, and how far they are turned."""


def turned_lights(lights: Sequence[Light], degrees: float, middle_mm: np.ndarray) -> tuple[Light, ...]:
    """Counterclockwise seen from above. Lights that belong to the camera stay: turn its axes for them."""
    if degrees == 0:
        return tuple(lights)
    turn = rotation(1, math.radians(degrees))
    return tuple(_turned(light, degrees, turn, np.asarray(middle_mm, np.float64)) for light in lights)


def _turned(light: Light, degrees: float, turn: np.ndarray, middle: np.ndarray) -> Light:
    if getattr(light, "relative_to", "world") == "camera" or light.kind in OF_THE_CAMERA:
        return light
    changes: dict[str, Any] = {}
    for name in ANGLES:
        if hasattr(light, name):
            changes[name] = getattr(light, name) + degrees
    if isinstance(light, MeshLight):
        changes["placement"] = _turned_placement(light.placement, turn, middle)
    for name in PLACES:
        if (place := getattr(light, name, None)) is not None:
            changes[name] = _turned_place(place, turn, middle)
    for name in DIRECTIONS:
        if (direction := getattr(light, name, None)) is not None:
            changes[name] = tuple((turn @ np.array(direction)).tolist())
    return light.model_copy(update=changes)


def _turned_place(place: Sequence[float], turn: np.ndarray, middle: np.ndarray) -> tuple[float, ...]:
    return tuple((middle + turn @ (np.array(place) - middle)).tolist())


def _turned_placement(placement: Placement, turn: np.ndarray, middle: np.ndarray) -> Placement:
    """Its turns about x, y and z, in this order, once the further turn follows them."""
    angles = np.radians(placement.rotation_deg)
    x, y, z = (rotation(axis, angle) for axis, angle in enumerate(angles))
    r = turn @ z @ y @ x
    about = (
        math.atan2(r[2, 1], r[2, 2]),
        math.asin(max(-1.0, min(1.0, -r[2, 0]))),
        math.atan2(r[1, 0], r[0, 0]),
    )
    return placement.model_copy(
        update={
            "rotation_deg": tuple(math.degrees(angle) for angle in about),
            "position_mm": _turned_place(placement.position_mm, turn, middle),
        }
    )
