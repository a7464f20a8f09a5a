"""Fiber axes in 10 + 10 bits: hemi-octahedral map (Cigolle et al. 2014, JCGT 3(2), section 3.3).

Twin of the decoder: shaders/math/hemi_octahedral.glsl.
"""

from __future__ import annotations

import numpy as np

DIRECTION_BITS = 10
_LEVELS = (1 << DIRECTION_BITS) - 1


def encode_axis(axis: np.ndarray) -> np.ndarray:
    """Axis words, uint32, shape [...], from unit axes, shape [..., 3]; a zero vector becomes the z axis."""
    x, y, z = np.moveaxis(np.asarray(axis, np.float32), -1, 0)
    flip = np.where(z < 0, np.float32(-1), np.float32(1))
    size = np.abs(x) + np.abs(y) + np.abs(z)
    scale = flip / np.where(size > 0, size, 1)
    u, v = x * scale, y * scale
    return _level(u + v) << DIRECTION_BITS | _level(u - v)


def decode_axis(words: np.ndarray) -> np.ndarray:
    """Unit axes with z >= 0, float32, shape [..., 3]."""
    a = _coordinate(words >> DIRECTION_BITS)
    b = _coordinate(words)
    u, v = (a + b) / 2, (a - b) / 2
    axis = np.stack([u, v, 1 - np.abs(u) - np.abs(v)], axis=-1)
    return axis / np.linalg.norm(axis, axis=-1, keepdims=True)


def _level(coordinate: np.ndarray) -> np.ndarray:
    # an even number of levels is used, so that 0 is one of them and the coordinate axes are exact
    return np.rint((coordinate * 0.5 + 0.5) * (_LEVELS - 1)).astype(np.uint32)


def _coordinate(words: np.ndarray) -> np.ndarray:
    return ((words & _LEVELS) / np.float32(_LEVELS - 1) * 2 - 1).astype(np.float32)
