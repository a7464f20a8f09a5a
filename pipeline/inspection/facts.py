"""What is said of a file, by name, and the two things said of many."""

from __future__ import annotations

from typing import Any

import numpy as np

Facts = dict[str, Any]
"""What is said of a file, by name."""


def value_range(values: np.ndarray) -> list[float]:
    finite = values[np.isfinite(values)]
    return [float(finite.min()), float(finite.max())] if finite.size else []


def bounds(points: np.ndarray) -> Facts:
    if not len(points):
        return {}
    return {"from [mm]": points.min(axis=0).tolist(), "to [mm]": points.max(axis=0).tolist()}
