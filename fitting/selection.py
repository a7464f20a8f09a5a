"""Which measured directions a fit sees: files joined, masks applied, angles held out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from weft.files.errors import InputError

from .config import FitConfig
from .masks import in_region
from .measurement_file import load_measurements
from .measurements import Measurements

SAME_ANGLE_DEG = 1e-6
_PER_DIRECTION = ("theta_i", "phi_i", "theta_o", "phi_o", "values", "sigma", "usable")


def load_all(paths: Sequence[Path]) -> Measurements:
    """The files as one. Raises `InputError` where they do not fit together."""
    parts = [load_measurements(path) for path in paths]
    first = parts[0]
    for path, part in zip(paths[1:], parts[1:], strict=True):
        for name, found, expected in (
            ("quantity", part.quantity, first.quantity),
            ("number of channels", part.values.shape[1], first.values.shape[1]),
            ("scale_known", part.scale_known, first.scale_known),
            ("whether sigma is stated", part.sigma is not None, first.sigma is not None),
        ):
            if found != expected:
                raise InputError(f"has another {name} ({found}) than {paths[0].name} ({expected})", path=path)
    if len(parts) == 1:
        return first
    joined: dict[str, Any] = {name: _joined(parts, name) for name in _PER_DIRECTION}
    return replace(first, **joined, source="; ".join(part.source for part in parts if part.source))


def _joined(parts: Sequence[Measurements], name: str) -> NDArray | None:
    if all(getattr(part, name) is None for part in parts):
        return None
    if name == "usable":
        return np.concatenate([usable(part) for part in parts])
    return np.concatenate([getattr(part, name) for part in parts])


def usable(measurements: Measurements) -> NDArray[np.bool_]:
    if measurements.usable is None:
        return np.ones(len(measurements), dtype=bool)
    return measurements.usable


def split(measurements: Measurements, config: FitConfig) -> tuple[Measurements, Measurements | None]:
    """What the fit sees, and what is held out (None: nothing)."""
    masked = [in_region(measurements, region) for region in config.mask]
    kept = usable(measurements) & ~np.any([np.zeros(len(measurements), dtype=bool), *masked], axis=0)
    held = np.zeros(len(measurements), dtype=bool)
    lights = np.degrees(measurements.theta_i)
    for angle in config.held_out_theta_i_deg:
        at = np.abs(lights - angle) < SAME_ANGLE_DEG
        if not at.any():
            known = ", ".join(f"{light:g}" for light in np.unique(np.round(lights, 6)))
            raise InputError(
                f"fit: held_out_theta_i_deg: there is no light at {angle:g} deg, only at {known}"
            )
        held |= at
    if not (kept & ~held).any():
        raise InputError("fit: masks and held-out angles leave no measured direction")
    return take(measurements, kept & ~held), take(measurements, kept & held) if (kept & held).any() else None


def take(measurements: Measurements, chosen: NDArray[np.bool_]) -> Measurements:
    arrays = {name: getattr(measurements, name) for name in _PER_DIRECTION}
    parts: dict[str, Any] = {name: None if array is None else array[chosen] for name, array in arrays.items()}
    return replace(measurements, **(parts | {"usable": None}))
