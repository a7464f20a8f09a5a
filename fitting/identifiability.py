"""Which parameters the data cannot tell apart, by name, and the tie that resolves each.

The Jacobian's null space finds every exact degeneracy. The known ones of the model are null directions within
a few parameters each; what remains beyond them is named by the parameters that take part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .config import WIDTHS
from .parameterization import FRESNEL_TT, SCALE, color_slice, grazing_slice
from .uncertainty import NULL_SINGULAR_VALUE, Uncertainty

Array = NDArray[np.float64]

GAMMA_TT = WIDTHS.index("azimuthal_width_tt_deg")
WEAK = 0.5
"""A standard error of this part of the value is worth a word."""
TAKES_PART = 1e-3
"""Share in a null direction, of which the largest is one."""
IN_PLANE = 1e-3
"""sin(phi) below this lies in the plane of the light and the fiber."""


@dataclass(frozen=True)
class Degeneracy:
    """Parameters that change together without a change of the data."""

    name: str
    parameters: tuple[str, ...]
    exact: bool
    """False: the data do see it, but barely."""
    remedy: str


@dataclass(frozen=True)
class _Known:
    name: str
    remedy: str
    within: tuple[int, ...]
    """Entries of the parameters among which it lies."""


def find_degeneracies(
    x: Array,
    jacobian: Array,
    uncertainty: Uncertainty,
    names: Sequence[str],
    *,
    free: NDArray[np.bool_],
    lights: Array,
    azimuths: Array,
) -> list[Degeneracy]:
    """Every one there is at the minimum. `lights` and `azimuths` [rad] are those of the data."""
    size = np.linalg.norm(jacobian, axis=0)
    silent = free & (size <= 1e-12 * size.max(initial=0.0))
    seen = free & ~silent
    found = [
        Degeneracy(f"{names[i]} has no effect on the data", (names[i],), True, "Fix it.")
        for i in map(int, np.flatnonzero(silent))
    ]
    explained = np.zeros((0, len(x)))
    columns = jacobian / np.where(size > 0, size, 1.0)
    for known in [*_known_degeneracies(len(names), lights, azimuths), _anything(len(names))]:
        chosen = np.intersect1d(known.within, np.flatnonzero(seen))
        new = _beyond(_null_space(columns, chosen), explained)
        explained = np.vstack([explained, new])
        found += [Degeneracy(known.name, _taking_part(row, names), True, known.remedy) for row in new]
    return found + _weak(x, uncertainty, names, azimuths, found)


def _known_degeneracies(count: int, lights: Array, azimuths: Array) -> list[_Known]:
    """Those that the data allow at all, the smallest first."""
    channels = (grazing_slice(count).start - SCALE - 1) // 4
    fresnel, red, tt, trt = (
        tuple(range(count)[color_slice(color, channels)])
        for color in ("fresnel_r", "color_r", "color_tt", "color_trt")
    )
    known = [
        _Known(*_INNER, (FRESNEL_TT, *tt, *trt)),
        _Known(*_SCALE, (SCALE, *red, *tt, *trt)),
    ]
    if np.ptp(np.abs(lights)) < 1e-6:
        known.append(_Known(*_ONE_ANGLE, (FRESNEL_TT, SCALE, *fresnel, *red, *tt, *trt)))
    if _in_plane(azimuths):
        known.append(_Known(*_IN_PLANE, (GAMMA_TT, FRESNEL_TT, *tt, *trt)))
    return known


def _anything(count: int) -> _Known:
    remedy = "Fix or tie one of them, or measure other directions."
    return _Known("combination of parameters", remedy, tuple(range(count)))


def _in_plane(azimuths: Array) -> bool:
    return bool(np.abs(np.sin(azimuths)).max(initial=0.0) < IN_PLANE)


def _null_space(columns: Array, chosen: NDArray[np.int64]) -> Array:
    """Directions within the chosen unit columns that change nothing, rows of shape [P]."""
    if len(chosen) == 0:
        return np.zeros((0, columns.shape[1]))
    _, singular, vt = np.linalg.svd(columns[:, chosen], full_matrices=False)
    null = vt[singular <= NULL_SINGULAR_VALUE * singular.max()]
    rows = np.zeros((len(null), columns.shape[1]))
    rows[:, chosen] = null
    return rows


def _beyond(rows: Array, explained: Array) -> Array:
    """An orthonormal basis of what the rows span beyond what is explained."""
    rest = rows - (rows @ explained.T) @ explained
    if len(rest) == 0:
        return rest
    _, singular, vt = np.linalg.svd(rest, full_matrices=False)
    return np.asarray(vt[singular > 1e-3])


def _taking_part(row: Array, names: Sequence[str]) -> tuple[str, ...]:
    share = np.abs(row) / np.abs(row).max()
    return tuple(names[i] for i in map(int, np.flatnonzero(share > TAKES_PART)))


def _weak(
    x: Array, uncertainty: Uncertainty, names: Sequence[str], azimuths: Array, found: list[Degeneracy]
) -> list[Degeneracy]:
    errors = uncertainty.standard_errors
    named = {name for degeneracy in found for name in degeneracy.parameters}
    result = []
    for i in map(int, np.flatnonzero(np.isfinite(errors) & (errors > WEAK * np.abs(x)) & (x != 0))):
        if names[i] in named:
            continue
        name, remedy = f"{names[i]} is barely determined", "Fix or tie it, or measure more directions."
        if i == GAMMA_TT and _in_plane(azimuths):
            name, remedy = _IN_PLANE
        partners = _correlated(i, uncertainty, names)
        named |= {names[i], *partners}
        result.append(Degeneracy(name, (names[i], *partners), False, remedy))
    return result


def _correlated(i: int, uncertainty: Uncertainty, names: Sequence[str]) -> tuple[str, ...]:
    deviation = np.sqrt(np.maximum(np.diag(uncertainty.covariance), 1e-300))
    correlation = uncertainty.covariance[i] / (deviation[i] * deviation)
    return tuple(names[j] for j in map(int, np.flatnonzero(np.abs(correlation) > 0.95)) if j != i)


_INNER = (
    "C_TT * F_TT and C_TRT * (1 - F_TT)",
    "Only these products reach the data. Tie color_trt to color_tt with power 1.9 (absorption; the default), "
    "set brightest_tt, or fix fresnel_tt.",
)
_SCALE = (
    "scale * C_R, scale * C_TT and scale * C_TRT",
    "Fix color_r (the default is 1), or fix the scale.",
)
_ONE_ANGLE = (
    "C_R * F_R at one angle",
    "Measure at a second inclination of the light, or fix color_r (the default is 1) and the scale.",
)
_IN_PLANE = (
    "gamma_TT from in-plane data alone",
    f"Measure outside the plane of light and fiber, or fix {WIDTHS[GAMMA_TT]}.",
)
