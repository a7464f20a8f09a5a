"""Directions that an instrument gets wrong, as masks of shape [N], True where a fit should not look.

`in_region` is what a job's [[fit.mask]] says: ranges of angles, and the masks below that follow the geometry.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .config import MaskRegion
from .measurements import Array, Measurements

Mask = NDArray[np.bool_]


def in_region(measurements: Measurements, region: MaskRegion) -> Mask:
    """Where every condition of the region is true."""
    phi = np.degrees(measurements.phi_o - measurements.phi_i)
    angles = {
        "theta_i_deg": np.degrees(measurements.theta_i),
        "theta_o_deg": np.degrees(measurements.theta_o),
        "phi_deg": phi - 360 * np.round(phi / 360),
    }
    conditions = [
        (limits[0] <= angle) & (angle <= limits[1])
        for name, angle in angles.items()
        if (limits := getattr(region, name)) is not None
    ]
    conditions += [
        mask(measurements, np.radians(reach))
        for name, mask in _BY_GEOMETRY.items()
        if (reach := getattr(region, f"{name}_deg")) is not None
    ]
    return np.logical_and.reduce(conditions)


def beyond(measurements: Measurements, most: float) -> Mask:
    """Where light or detector is inclined by more than `most` [rad]: grazing, the sample's edges count."""
    return np.maximum(np.abs(measurements.theta_i), np.abs(measurements.theta_o)) > most


def near_specular(measurements: Measurements, within: float) -> Mask:
    """Where the detector is less than `within` [rad] from the light's mirror image.

    A surface has one such direction. A fiber has a cone of them, theta_o = -theta_i: there the difference
    in inclination counts.
    """
    if measurements.quantity == "brdf":
        return _separation(measurements, measurements.theta_i, measurements.phi_i + np.pi) < within
    return np.abs(measurements.theta_o + measurements.theta_i) < within


def near_forward(measurements: Measurements, within: float) -> Mask:
    """Where the detector is less than `within` [rad] from the light's way straight through the fiber.

    There the beam itself reaches the detector, past the fiber. Never so for a surface.
    """
    if measurements.quantity == "brdf":
        return np.zeros(len(measurements), dtype=bool)
    return _separation(measurements, -measurements.theta_i, measurements.phi_i + np.pi) < within


def near_light(measurements: Measurements, within: float) -> Mask:
    """Where the detector is less than `within` [rad] from the light, which it then shades."""
    return _separation(measurements, measurements.theta_i, measurements.phi_i) < within


def _separation(measurements: Measurements, theta: Array, phi: Array) -> Array:
    """Angle between the detector and a direction [rad], by the haversine, exact for small angles too."""
    from_pole = measurements.quantity == "brdf"
    ring = np.sin if from_pole else np.cos
    turn = np.sin((measurements.phi_o - phi) / 2) ** 2
    chord = np.sin((measurements.theta_o - theta) / 2) ** 2 + ring(measurements.theta_o) * ring(theta) * turn
    return 2.0 * np.arcsin(np.sqrt(np.clip(chord, 0.0, 1.0)))


_BY_GEOMETRY = {
    "beyond": beyond,
    "near_specular": near_specular,
    "near_forward": near_forward,
    "near_light": near_light,
}
