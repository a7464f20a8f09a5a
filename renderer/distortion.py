"""Radial lens distortion (Brown 1971; k1 and k2 as OpenCV and calibration tools state them).

A point at distance r from the axis, in focal lengths, is seen at distance R = r (1 + k1 r² + k2 r⁴). Rays
need the inverse: six steps of Newton's method on the ratio s = r / R, s + a s³ + b s⁵ = 1 with a = k1 R²,
b = k2 R⁴. Twin: shaders/camera/distortion.glsl.
"""

from __future__ import annotations

import numpy as np

from weft.files.errors import InputError

STEPS = 6
TOLERANCE = 1e-6
"""By which s may miss; a hundredth of a pixel in a picture of 10,000."""
RADII = 256


def undistorted(place: np.ndarray, k1: float, k2: float) -> np.ndarray:
    """Where without the lens one would see what is seen at `place`, in focal lengths, shape [..., 2]."""
    r2 = (place**2).sum(axis=-1)
    return place * _ratio(k1 * r2, k2 * r2**2)[..., None]


def distorted(place: np.ndarray, k1: float, k2: float) -> np.ndarray:
    """Where the lens shows what without it is seen at `place`, in focal lengths, shape [..., 2]."""
    r2 = (place**2).sum(axis=-1, keepdims=True)
    return place * (1 + k1 * r2 + k2 * r2**2)


def _ratio(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    s = np.ones_like(a)
    for _ in range(STEPS):
        q = s**2
        with np.errstate(all="ignore"):
            s = s - (s * (1 + q * (a + b * q)) - 1) / (1 + q * (3 * a + 5 * b * q))
    return s


def reaches(k1: float, k2: float, radius: float) -> bool:
    """Whether all of the picture, up to `radius` focal lengths from its middle, shows something once."""
    seen = np.linspace(0, radius, RADII)
    s = _ratio(k1 * seen**2, k2 * seen**4)
    r = s * seen
    with np.errstate(all="ignore"):
        missed = np.abs(r * (1 + k1 * r**2 + k2 * r**4) - seen)
        grows = 1 + 3 * k1 * r**2 + 5 * k2 * r**4 > 0
    # what lies nearer to the axis must be seen nearer to it, so that nothing is seen twice
    return bool((missed <= TOLERANCE * max(radius, 1.0)).all() and grows.all() and (np.diff(r) > 0).all())


def refuse_folds(k1: float, k2: float, radius: float) -> None:
    """Raises `InputError` for a lens whose picture ends before its corners."""
    if (k1 or k2) and not reaches(k1, k2, radius):
        raise InputError(
            f"render.camera: with distortion_k1 = {k1:g}, distortion_k2 = {k2:g} the corners show nothing.",
            hint="Take smaller values, or a smaller fov_deg.",
        )
