"""Tables of the reciprocal longitudinal lobes as shaders/phase/fiber_symmetric.glsl reads them.

One medium's rows of vec4, lanes R at normal incidence, TT, TRT, R toward grazing: ln q and its slope at the
nodes of the scaled lobes, then tilt and bound of the envelopes for sampling by rejection. Nodes are at equal
steps of t = sqrt(1 - |theta| / 90°).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from weft.fiber_model.scattering.parameters import FiberScatteringParameters
from weft.fiber_model.scattering.phase import SYMMETRIC_MARGINALS, longitudinal_widths
from weft.fiber_model.scattering.symmetric import TABLE_CELLS, log_q_at, marginal_energy, symmetric_lobe

ENVELOPE_CELLS = 32
ENVELOPE_ROW = 2 * (TABLE_CELLS + 1)
TABLE_ROWS = ENVELOPE_ROW + 2 * (ENVELOPE_CELLS + 1)
"""Rows of vec4 per medium: 3.1 KB, 0.8 KB a lobe."""
BENDS = {"base": 0.9, "entering": 0.9, "grazing": 8.0}
"""Concavity of ln(q a cos²) that is used; measured about 1, and 9 on one side of grazing. For speed only."""

Array = NDArray[np.float64]

_HALF_PI = np.pi / 2
_MARGIN = 1e-4
"""Added to the bound for its rounding and for maxima between the points that were looked at."""


def table_constants_glsl() -> list[str]:
    bends = ", ".join(str(BENDS[marginal]) for marginal in SYMMETRIC_MARGINALS)
    return [
        f"const int FIBER_TABLE_CELLS = {TABLE_CELLS};",
        f"const int FIBER_ENVELOPE_CELLS = {ENVELOPE_CELLS};",
        f"const int FIBER_ENVELOPE_ROW = {ENVELOPE_ROW};",
        f"const vec4 FIBER_TABLE_BEND = vec4({bends});",
    ]


def symmetric_table(parameters: FiberScatteringParameters) -> Array:
    """The rows of one medium, [TABLE_ROWS, 4]."""
    widths = longitudinal_widths(parameters)
    lanes = [
        _lane(marginal, beta)
        for marginal, beta in zip(SYMMETRIC_MARGINALS, (*widths, widths[0]), strict=True)
    ]
    return np.stack(lanes, axis=1)


@lru_cache(maxsize=256)
def _lane(marginal: str, beta: float) -> Array:
    lobe = symmetric_lobe(marginal, beta)
    scaled = np.stack([lobe.log_q, lobe.slope / TABLE_CELLS], axis=1).ravel()
    return np.concatenate([scaled, np.stack(_envelope(marginal, beta), axis=1).ravel()])


def _envelope(marginal: str, beta: float) -> tuple[Array, Array]:
    """Tilt and bound at the nodes of |theta_o|: ln w(x) + bend x²/2 <= bound + tilt x, w = q a cos².

    x is theta on the side of -theta_o. The tilt is the left side's slope at the lobe's mode; any other would
    be valid too, and slower. The grazing lobe is drawn on that side only, with w raised by what the far adds.
    """
    near = _HALF_PI * (1 - np.linspace(1, 1e-4, 3000) ** 2)[1:]
    x = near if marginal == "grazing" else np.concatenate([-near[::-1], near])
    log_w = np.log(marginal_energy(marginal, np.cos(x))) + 2 * np.log(np.cos(x))
    log_w += log_q_at(symmetric_lobe(marginal, beta), x)
    left = log_w + 0.5 * BENDS[marginal] * x**2
    slope = np.gradient(left, x)
    tilts, bounds = [], []
    for theta_o in _HALF_PI * (1 - np.linspace(0, 1, ENVELOPE_CELLS + 1) ** 2):
        tilt = slope[np.argmax(log_w - 0.5 * ((x - theta_o) / beta) ** 2)]
        far = np.log1p(np.exp(-2 * x * theta_o / beta**2)) if marginal == "grazing" else 0.0
        tilts.append(tilt)
        bounds.append((left + far - tilt * x).max() + _MARGIN)
    return np.array(tilts), np.array(bounds)
