"""Scattering other than by fibers, for comparison with other renderers and with theory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from weft.files.errors import InputError

WHITE = (1.0, 1.0, 1.0)
BLACK = (0.0, 0.0, 0.0)
Rgb = tuple[float, float, float]


@dataclass(frozen=True)
class IsotropicPhase:
    """The same into all directions."""

    albedo: Rgb = WHITE
    """Linear RGB: what a collision leaves of the light."""
    emission: Rgb = BLACK
    """Radiance emitted per optical depth; an opaque medium that scatters nothing has this radiance."""


@dataclass(frozen=True)
class HenyeyGreensteinPhase:
    """Henyey and Greenstein 1941."""

    g: float
    """Mean cosine, within (-1, 1); positive scatters forward."""
    albedo: Rgb = WHITE
    emission: Rgb = BLACK

    def __post_init__(self) -> None:
        if not -1 < self.g < 1:
            raise InputError(f"render: Henyey-Greenstein's g is {self.g}; it must lie between -1 and 1.")


@dataclass(frozen=True)
class SggxPhase:
    """Specular microflakes along the fiber (Heitz et al. 2015), S = diag(roughness^2, 1, 1), fiber first."""

    roughness: float
    """Within (0, 1]; 1: a sphere. Projected extinction becomes that of the flakes, sqrt(w^T S w)."""
    albedo: Rgb = WHITE
    emission: Rgb = BLACK

    def __post_init__(self) -> None:
        if not 0 < self.roughness <= 1:
            raise InputError(f"render: SGGX roughness is {self.roughness}; it must lie in (0, 1].")


SimplePhase = IsotropicPhase | HenyeyGreensteinPhase | SggxPhase


def pack_simple(media: Sequence[SimplePhase]) -> np.ndarray:
    """Two rows per medium as shaders/path/phase_simple.glsl reads them, float32, shape [2 media, 4]."""
    rows = []
    for one in media:
        kind, shape = 0.0, 0.0
        if isinstance(one, HenyeyGreensteinPhase):
            kind, shape = 1.0, one.g
        elif isinstance(one, SggxPhase):
            kind, shape = 2.0, one.roughness
        rows += [[*one.albedo, kind], [*one.emission, shape]]
    return np.array(rows, np.float32)


def simple_constants(media: Sequence[SimplePhase]) -> dict[str, bool]:
    """Which kinds the shaders need."""
    return {
        "PHASE_HENYEY_GREENSTEIN": any(isinstance(one, HenyeyGreensteinPhase) for one in media),
        "PHASE_SGGX": any(isinstance(one, SggxPhase) for one in media),
    }


def flake_roughness(media: Sequence[object]) -> float:
    """The roughness of all SGGX media, 0 where there are none: their extinction depends on it."""
    found = {one.roughness for one in media if isinstance(one, SggxPhase)}
    if len(found) > 1 or (found and any(not isinstance(one, SggxPhase) for one in media)):
        raise InputError("render: SGGX media need one roughness, and no media of other kinds beside them.")
    return found.pop() if found else 0.0
