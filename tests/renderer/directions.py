"""Directions about the normal z, for tests of surfaces."""

from __future__ import annotations

import numpy as np


def direction(theta_deg, phi_deg):
    theta, phi = np.radians([theta_deg, phi_deg])
    return np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])


def hemisphere(cosines, azimuths):
    """Directions on a product of midpoints, shape [cosines, azimuths, 3]."""
    z = (np.arange(cosines) + 0.5)[:, None] / cosines
    phi = ((np.arange(azimuths) + 0.5) / azimuths * 2 - 1)[None, :] * np.pi
    r = np.sqrt(1 - z**2)
    return np.stack(np.broadcast_arrays(r * np.cos(phi), r * np.sin(phi), z), axis=-1)
