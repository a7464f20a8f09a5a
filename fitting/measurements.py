"""Measured scattering of one fiber or surface: directions, values, their errors, and what the numbers mean.

`theta_i`, `phi_i` point toward the light, `theta_o`, `phi_o` toward the detector, both away from the
sample. For a fiber, theta is the inclination from its normal plane and phi the azimuth around it, as
everywhere in weft; the light is the given direction: the model's value is `fiber_phase_eval(parameters,
wo=light, wi=detector)`. For a surface (`quantity = "brdf"`), theta is measured from the normal.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from weft.files.errors import InputError

Array = NDArray[np.float64]

QUANTITIES = ("phase_function", "bcsdf", "brdf")
"""Of a fiber: f_p per steradian, or S = f_p / cos theta_o (Zinke and Weber 2007); of a surface: the BRDF."""


@dataclass(frozen=True)
class Measurements:
    """N directions, each with a value per channel. Angles in radians."""

    theta_i: Array
    """Of the light, shape [N]."""
    phi_i: Array
    theta_o: Array
    """Of the detector, shape [N]."""
    phi_o: Array
    values: Array
    """Shape [N, channels]."""
    quantity: str
    sigma: Array | None = None
    """Standard deviations of `values`, same shape; None where the source states none."""
    scale_known: bool = True
    """False: the values are right up to one factor common to all."""
    usable: NDArray[np.bool_] | None = None
    """Shape [N]; False marks directions that a fit must leave out. None: all are usable."""
    channels: tuple[str, ...] = ()
    """Names of the channels, such as ("r", "g", "b"); empty: unnamed."""
    source: str = ""
    """Where the numbers come from, in words."""

    def __post_init__(self) -> None:
        if self.quantity not in QUANTITIES:
            what = f"measurements: quantity '{self.quantity}' is unknown"
            raise InputError(what, hint=f"Known: {', '.join(QUANTITIES)}.")
        count = len(self.theta_i)
        if self.values.ndim != 2:
            raise InputError("measurements: values need one row per direction and one column per channel")
        if self.channels and len(self.channels) != self.values.shape[1]:
            named, columns = len(self.channels), self.values.shape[1]
            raise InputError(f"measurements: {named} channels are named, but values have {columns} columns")
        for field in fields(self):
            array = getattr(self, field.name)
            if not isinstance(array, np.ndarray):
                continue
            if len(array) != count:
                raise InputError(f"measurements: {field.name} has {len(array)} rows, theta_i {count}")
            if array.dtype.kind == "f" and not np.isfinite(array).all():
                raise InputError(f"measurements: {field.name} holds a number that is not finite")
        if self.sigma is not None and (self.sigma.shape != self.values.shape or (self.sigma <= 0).any()):
            raise InputError("measurements: sigma needs one positive number per value")

    def __len__(self) -> int:
        return len(self.theta_i)
