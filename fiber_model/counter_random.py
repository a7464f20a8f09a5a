"""Random numbers as a function of what they are for: pcg4d of Jarzynski and Olano 2020, without state.

"Hash functions for GPU rendering", Journal of Computer Graphics Techniques 9(3). The key is (seed and
purpose, yarn, strand, event); each key gives four words of 32 bits. Twin in Warp: `random_kernels.pcg4d`.
"""

from __future__ import annotations

import numpy as np

PURPOSE_CROSS_SECTION = 0x9E3779B9
PURPOSE_MIGRATION = 0x7F4A7C15
PURPOSE_PLY_PHASE = 0x85EBCA6B
PURPOSE_LOOP = 0xC2B2AE35
PURPOSE_HAIR_COUNT = 0x27D4EB2F
PURPOSE_HAIR_PLACE = 0x165667B1
PURPOSE_HAIR_SHAPE = 0xD6E8FEB8
PURPOSE_PERTURBATION = 0x51ED270B
PURPOSE_THICKNESS_NOISE = 0x2545F491
PURPOSE_COLOR_NOISE = 0x94D049BB
PURPOSE_SLUB_COUNT = 0xBF58476D
PURPOSE_SLUB = 0x4CF5AD43
PURPOSE_WALK_COUNT = 0xFF51AFD7
PURPOSE_WALK = 0xC4CEB9FE
PURPOSE_WALK_STEP = 0x38495AB5
PURPOSE_DROOP_COUNT = 0x2127599B
PURPOSE_DROOP = 0xA0761D64
PURPOSE_YARN_COLOR = 0xE7037ED1

Words = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]

REDRAWS = 16
"""Draws of a rejection sampler before it settles for the border of what it accepts."""


def seed_key(seed: int) -> int:
    """The user's seed, mixed: seeds 1 and 2 share no keys although purposes and draws are added."""
    return int(pcg4d(seed, 0, 0, 0)[0])


def pcg4d(x: object, y: object, z: object, w: object) -> Words:
    """Four independent uint32 words for each key (x, y, z, w); keys broadcast and are taken modulo 2^32."""
    multiplier, increment = np.uint32(1664525), np.uint32(1013904223)
    with np.errstate(over="ignore"):
        a, b, c, d = (_words(key) * multiplier + increment for key in (x, y, z, w))
    shift = np.uint32(16)
    a, b, c, d = np.broadcast_arrays(a, b, c, d)
    a, b, c, d = _mix(a, b, c, d)
    return _mix(a ^ (a >> shift), b ^ (b >> shift), c ^ (c >> shift), d ^ (d >> shift))


def uniform(word: np.ndarray) -> np.ndarray:
    """Float64 in (0, 1), the middle of each of 2^32 intervals."""
    return (word.astype(np.float64) + 0.5) * 2.0**-32


def uniform_single(word: np.ndarray) -> np.ndarray:
    """Float32 in (0, 1), the middle of each of 2^23 intervals (so that 1 cannot be reached by rounding)."""
    return ((word >> np.uint32(9)).astype(np.float32) + np.float32(0.5)) * np.float32(2.0**-23)


def normal_pair(word_radius: np.ndarray, word_angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two independent standard normals, float32, by Box and Muller 1958."""
    radius = np.sqrt(np.float32(-2.0) * np.log(uniform_single(word_radius)))
    angle = np.float32(2.0 * np.pi) * uniform_single(word_angle)
    return radius * np.cos(angle), radius * np.sin(angle)


LARGEST_NORMAL = float(np.sqrt(2.0 * 24.0 * np.log(2.0)))
"""No normal from `normal_pair` is larger than this: uniforms are at least 2^-24."""


def poisson(mean: np.ndarray, x: object, y: object, z: object) -> np.ndarray:
    """Poisson counts, int64, for each key (x, y, z), by inversion; above a mean of 32, sums of several."""
    mean, x, y, z = np.broadcast_arrays(np.asarray(mean, dtype=np.float64), _words(x), _words(y), _words(z))
    parts = np.maximum(np.ceil(mean / 32.0), 1.0)
    count = np.zeros(mean.shape, dtype=np.int64)
    for part in range(int(parts.max(initial=0))):
        inside = parts > part
        u = uniform(pcg4d(x[inside], y[inside], z[inside], part)[0])
        count[inside] += _poisson_inverse(u, (mean / parts)[inside])
    return count


def _poisson_inverse(u: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """The smallest count whose Poisson probability, summed from zero, reaches u."""
    term = np.exp(-mean)
    total, count = term.copy(), np.zeros(u.shape, dtype=np.int64)
    rising = u > total
    while rising.any():
        count[rising] += 1
        term[rising] *= mean[rising] / count[rising]
        total[rising] += term[rising]
        rising &= (u > total) & (term > 0)
    return count


def _words(key: object) -> np.ndarray:
    return np.asarray(np.asarray(key, dtype=np.int64) & 0xFFFFFFFF, dtype=np.uint32)


def _mix(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> Words:
    with np.errstate(over="ignore"):
        a = a + b * d
        b = b + c * a
        c = c + a * b
        d = d + b * c
    return a, b, c, d
