"""What `weft inspect` says of measured scattering."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

MAX_CHANNELS = 12
"""How many are shown; spectra have hundreds."""


def measurement_facts(path: Path) -> dict[str, Any]:
    """Angles, values and errors of measured scattering, in any format that weft reads."""
    from weft.fitting.measurement_file import load_measurements

    found = load_measurements(path)
    usable = np.ones(len(found), dtype=bool) if found.usable is None else found.usable
    names = found.channels or tuple(str(index + 1) for index in range(found.values.shape[1]))
    angles = ("theta_i", "phi_i", "theta_o", "phi_o")
    facts = {
        "content": "measurements",
        "quantity": found.quantity,
        "scale": "known" if found.scale_known else "free",
        "directions": len(found),
        "usable": int(usable.sum()),
        "angles of the light": len(np.unique(np.round(np.rad2deg(found.theta_i), 4))),
        **{f"{name} [deg]": _ends(np.rad2deg(getattr(found, name))) for name in angles},
        "values": {name: _ends(found.values[usable, i]) for i, name in enumerate(names[:MAX_CHANNELS])},
    }
    if len(names) > MAX_CHANNELS:
        facts["more channels"] = len(names) - MAX_CHANNELS
    facts["sigma"] = "not stated" if found.sigma is None else _ends(found.sigma[usable])
    return facts | {"source": found.source.replace("\n", "; ") or "not stated"}


def _ends(numbers: np.ndarray) -> list[float]:
    return [float(numbers.min()), float(numbers.max())] if numbers.size else []
