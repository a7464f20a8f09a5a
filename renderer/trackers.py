"""Which estimators go through the volume: for free flights, and for the transmittance of shadow rays."""

from __future__ import annotations

import numpy as np

from .brick_pool import BRICK_VOXELS, BRICKS_PER_CHUNK, BrickPool
from .media import OtherMedia

STEPS = {
    "exact": ("exact_step", "track_exact"),
    "delta": ("delta_step", "track_delta"),
    "ratio": ("delta_step", "track_delta"),
    "residual_ratio": ("residual_step", "residual_step"),
    "march": ("march", "march_step"),
}
"""The GLSL function of each, and its file under shaders/medium/."""
ALONE = {("exact", "exact"): "track_exact", ("delta", "ratio"): "track_delta"}
"""Pairs whose one function does both."""
CONTROL_LEVELS = 16
MEAN_SINE = np.pi / 4
"""Of the angle between a fiber and a random direction."""


def track_piece(flights: str, shadows: str, media: OtherMedia | None) -> str:
    """GLSL that defines track(), by the estimators of flights and of shadow rays."""
    if media is not None:
        return _include("track_media")
    if (flights, shadows) in ALONE:
        return _include(ALONE[flights, shadows])
    lines = ""
    for name, file in dict(STEPS[one] for one in (flights, shadows)).items():
        renamed = file.startswith("track_")
        lines += f"#define track {name}\n{_include(file)}#undef track\n" if renamed else _include(file)
    pair = f"#define track_flight {STEPS[flights][0]}\n#define track_shadow {STEPS[shadows][0]}\n"
    return lines + pair + _include("track_pair")


def _include(file: str) -> str:
    return f'#include "medium/{file}.glsl"\n'


def control_sixteenths(pool: BrickPool, *, projected: bool) -> np.ndarray:
    """Control extinction of each brick in sixteenths of its majorant: the mean of its voxels; uint32."""
    mean = np.empty(len(pool.voxels))
    for start in range(0, len(mean), BRICKS_PER_CHUNK):
        chunk = slice(start, start + BRICKS_PER_CHUNK)
        mean[chunk] = (pool.voxels[chunk][:, :BRICK_VOXELS] >> 20).mean(axis=1)
    share = mean / np.maximum(pool.majorant_level, 1) * (MEAN_SINE if projected else 1.0)
    return np.clip(np.rint(share * CONTROL_LEVELS), 0, CONTROL_LEVELS - 1).astype(np.uint32)
