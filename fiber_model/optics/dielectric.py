"""A smooth interface between two clear media, for unpolarized light (Fresnel and Snell; Born and Wolf, 1.5).

Cosines are those of the full, three-dimensional angle against the normal. Twins in Warp:
`interface_kernels.fresnel` and `interface_kernels.refract`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def fresnel(cosine: ArrayLike, eta: float) -> Array:
    """Reflectance of unpolarized light that meets a medium `eta` times as dense; 1 where nothing enters."""
    cosine = np.abs(np.asarray(cosine, dtype=np.float64))
    square = 1 - (1 - cosine**2) / eta**2
    inside = np.sqrt(np.maximum(square, 0.0))
    across = (cosine - eta * inside) / (cosine + eta * inside)
    along = (eta * cosine - inside) / (eta * cosine + inside)
    return np.where(square > 0, 0.5 * (across**2 + along**2), 1.0)
