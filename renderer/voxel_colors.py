"""The dye of each voxel: a second word behind the words of a brick, where a volume has colors.

A word is the square roots of linear red, green and blue, ten bits each, so that dark dyes keep their hue;
white is exact. A volume without colors has no such words. Twin: `shaders/medium/tint.glsl`.
"""

from __future__ import annotations

import numpy as np

from weft.files.errors import InputError

COLOR_BITS = 10
LARGEST = (1 << COLOR_BITS) - 1
WHITE = LARGEST << (2 * COLOR_BITS) | LARGEST << COLOR_BITS | LARGEST


def color_words(albedo: np.ndarray) -> np.ndarray:
    """Words of linear RGB [..., 3], uint32. What noise along the yarn lifts above 1 counts as 1."""
    if albedo.size and not (albedo.min() >= 0 and albedo.max() < np.inf):
        raise InputError("render: the volume has colors that are negative or not finite.")
    levels = np.rint(np.sqrt(np.minimum(albedo, 1)) * LARGEST).astype(np.uint32)
    words: np.ndarray = levels[..., 0] << (2 * COLOR_BITS) | levels[..., 1] << COLOR_BITS | levels[..., 2]
    return words


def colors_of_words(words: np.ndarray) -> np.ndarray:
    """Linear RGB of words, float64, shape [..., 3]."""
    levels = np.stack([words >> (2 * COLOR_BITS), words >> COLOR_BITS & LARGEST, words & LARGEST], axis=-1)
    return np.square(levels / LARGEST)
