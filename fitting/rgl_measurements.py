"""A BRDF of the RGL database as measurements: a row for each point of its warped grids."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from weft.files.errors import InputError
from weft.files.measured.rgl import read_rgl

from .measurements import Measurements
from .surface_directions import angles


def read_rgl_measurements(path: Path) -> Measurements:
    """The BRDF [1/sr] per wavelength, or in RGB; negative values are not usable.

    There is no way back: the warp of a .bsdf file does not follow from directions and values.
    """
    brdf = read_rgl(path)
    light, detector, values = brdf.measured()
    if not len(light):
        raise InputError("no direction of this file lies above the surface", path=path)
    (theta_i, phi_i), (theta_o, phi_o) = angles(light), angles(detector)
    description = brdf.fields.get("description", np.zeros(0, dtype=np.uint8))
    words = description.tobytes()[:1000].decode("utf-8", "replace").strip("\0 \n")
    return Measurements(
        theta_i=theta_i,
        phi_i=phi_i,
        theta_o=theta_o,
        phi_o=phi_o,
        values=values,
        quantity="brdf",
        usable=np.all(values >= 0, axis=1),
        channels=brdf.channels,
        source=f"RGL file {path.name}" + (f"\n{words}" if words else ""),
    )
