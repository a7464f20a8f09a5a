"""Clear sky and sun by day: Preetham, Shirley and Smits 1999, "A practical analytic model for daylight".

Radiance 1 stands for 10,000 cd/m2 of a white surface, so irradiance 1 for 10,000 lux; scaled by `intensity`.
"""

from __future__ import annotations

import math

import numpy as np

from .config import DaylightLight, DirectionalLight

_PEREZ = np.array(
    [  # A to E of Y, x and y: (per turbidity, constant), table of their appendix A.2
        [[0.1787, -1.4630], [-0.3554, 0.4275], [-0.0227, 5.3251], [0.1206, -2.5771], [-0.0670, 0.3703]],
        [[-0.0193, -0.2592], [-0.0665, 0.0008], [-0.0004, 0.2125], [-0.0641, -0.8989], [-0.0033, 0.0452]],
        [[-0.0167, -0.2608], [-0.0950, 0.0092], [-0.0079, 0.2102], [-0.0441, -1.6537], [-0.0109, 0.0529]],
    ]
)
_ZENITH = np.array(
    [  # x and y of the zenith: rows by turbidity squared, turbidity, 1; columns by powers 3 to 0 of the angle
        [
            [0.00166, -0.00375, 0.00209, 0.0],
            [-0.02903, 0.06377, -0.03202, 0.00394],
            [0.11693, -0.21196, 0.06052, 0.25886],
        ],
        [
            [0.00275, -0.00610, 0.00317, 0.0],
            [-0.04214, 0.08970, -0.04153, 0.00516],
            [0.15346, -0.26756, 0.06670, 0.26688],
        ],
    ]
)
_RGB_FROM_XYZ = np.array(
    [
        [3.2404542, -1.5371385, -0.4985314],
        [-0.9692660, 1.8760108, 0.0415560],
        [0.0556434, -0.2040259, 1.0572252],
    ]
)
_WAVELENGTHS_UM = np.array([0.61, 0.55, 0.465])
"""That stand for red, green and blue in the air's attenuation of the sun."""
_SUN_OUTSIDE = 13.3
"""Irradiance outside of the air, 133,000 lux, white."""
_RADIANCE_PER_KCD = 0.1


def sun_direction(light: DaylightLight) -> np.ndarray:
    """Toward the sun, y up."""
    height, turn = math.radians(light.sun_elevation_deg), math.radians(light.sun_azimuth_deg)
    flat = math.cos(height)
    return np.array([flat * math.sin(turn), math.sin(height), flat * math.cos(turn)])


def sun_light(light: DaylightLight) -> DirectionalLight:
    """The sun through the air, parallel light."""
    angle = math.pi / 2 - math.radians(light.sun_elevation_deg)
    mass = 1 / (math.cos(angle) + 0.15 * (93.885 - math.degrees(angle)) ** -1.253)
    haze = 0.04608 * light.turbidity - 0.04586
    depth = 0.008735 * _WAVELENGTHS_UM**-4.08 + haze * _WAVELENGTHS_UM**-1.3
    red, green, blue = _SUN_OUTSIDE * np.exp(-depth * mass) * light.intensity
    direction = sun_direction(light)
    return DirectionalLight(direction=tuple(direction.tolist()), irradiance=(red, green, blue))


def daylight(directions: np.ndarray, light: DaylightLight, solid_angles: np.ndarray) -> np.ndarray:
    """Radiance of sky and ground, RGB. Directions in the world, [rows, columns, 3]; `solid_angles` [sr]."""
    height = directions[..., 1]
    above = np.where(height[..., None] > 0, sky_color(directions, light), 0.0)
    reached = (above * (np.maximum(height, 0) * solid_angles)[..., None]).sum(axis=(0, 1))
    sun = np.array(sun_light(light).irradiance) / max(light.intensity, 1e-30) if light.sun else np.zeros(3)
    ground = (
        np.array(light.ground) / np.pi * (reached + sun * math.sin(math.radians(light.sun_elevation_deg)))
    )
    return np.where(height[..., None] > 0, above, ground) * light.intensity


def sky_color(directions: np.ndarray, light: DaylightLight) -> np.ndarray:
    """Linear RGB of the sky; directions below the horizon see what is just above it."""
    angle = math.pi / 2 - math.radians(light.sun_elevation_deg)
    to_sun = np.arccos(np.clip(directions @ sun_direction(light), -1, 1))
    cosine = np.maximum(directions[..., 1], 0.01)
    t = light.turbidity
    coefficients = _PEREZ @ [t, 1.0]
    sky, zenith = (
        np.stack([_perez(row, c, g) for row in coefficients], axis=-1)
        for c, g in ((cosine, to_sun), (np.array(1.0), np.array(angle)))
    )
    luminance, x, y = np.moveaxis(zenith_color(angle, t) * sky / zenith, -1, 0)
    xyz = np.stack([x / y, np.ones_like(x), (1 - x - y) / y], axis=-1) * luminance[..., None]
    return np.maximum(xyz @ _RGB_FROM_XYZ.T, 0) * _RADIANCE_PER_KCD


def zenith_color(angle: float, turbidity: float) -> np.ndarray:
    """Luminance [kcd/m2], x and y straight up, for a sun at `angle` from there [rad]."""
    chi = (4 / 9 - turbidity / 120) * (np.pi - 2 * angle)
    luminance = (4.0453 * turbidity - 4.9710) * math.tan(chi) - 0.2155 * turbidity + 2.4192
    powers = np.array([angle**3, angle**2, angle, 1.0])
    return np.array([luminance, *(_ZENITH @ powers @ [turbidity**2, turbidity, 1.0])])


def _perez(row: np.ndarray, cosine: np.ndarray, to_sun: np.ndarray) -> np.ndarray:
    """Perez, Seals and Michalsky 1993: (1 + A exp(B / cos)) (1 + C exp(D g) + E cos^2 g)."""
    a, b, c, d, e = row
    return (1 + a * np.exp(b / cosine)) * (1 + c * np.exp(d * to_sun) + e * np.cos(to_sun) ** 2)
