"""Colors of whole yarns: stripes by the yarn's number in its pattern, lightness that differs by yarn and ply.

What a ply has before color noise along the yarn is its ply color x the stripe's color x the lightness of its
yarn x its own lightness. Not in Zhao, Luan and Bala 2016.
"""

from __future__ import annotations

import numpy as np

from .config import FibersConfig
from .counter_random import PURPOSE_YARN_COLOR, normal_pair, pcg4d
from .yarns.yarns import YarnSet, rows_within_types

Palette = tuple[tuple[float, float, float], ...]
"""Colors of a yarn's plies, linear RGB; the list repeats."""
WHITE = (1.0, 1.0, 1.0)


def yarn_palettes(configs: list[FibersConfig], yarns: YarnSet, seed: int) -> list[Palette]:
    """Of each yarn; empty is white."""
    rows = yarn_rows(yarns)
    return [
        _palette(config, yarn, int(row), seed)
        for yarn, (config, row) in enumerate(zip(configs, rows, strict=True))
    ]


def yarn_rows(yarns: YarnSet) -> np.ndarray:
    """The number of each yarn among those of its type in the pattern, int64, shape [yarn_count]."""
    if yarns.row is not None:
        return yarns.row.astype(np.int64)
    return rows_within_types(yarns.yarn_type)


def _palette(config: FibersConfig, yarn: int, row: int, seed: int) -> Palette:
    variation = config.variation
    plain = not config.yarn_colors and not (variation.yarn_color_sd or variation.ply_color_sd)
    if plain:
        return config.ply_colors
    plies: Palette = config.ply_colors or (WHITE,)
    if variation.ply_color_sd:
        count = config.cords * config.plies
        plies = tuple(plies[i % len(plies)] for i in range(count))
    factor = _lightness(seed, yarn, 0, variation.yarn_color_sd) * np.array(stripe_color(config, row))
    each = [_lightness(seed, yarn, 1 + i, variation.ply_color_sd) for i in range(len(plies))]
    return tuple(
        tuple((np.array(color) * factor * own).tolist()) for color, own in zip(plies, each, strict=True)
    )


def stripe_color(config: FibersConfig, row: int) -> tuple[float, float, float]:
    """The color that yarn number `row` takes from `yarn_colors` and `yarn_color_runs`."""
    if not config.yarn_colors:
        return WHITE
    count = len(config.yarn_colors)
    runs = [config.yarn_color_runs[i % len(config.yarn_color_runs)] for i in range(count)]
    place = row % sum(runs)
    return config.yarn_colors[int(np.searchsorted(np.cumsum(runs), place, side="right"))]


def _lightness(seed: int, yarn: int, part: int, sd: float) -> float:
    """Lognormal of mean 1 and standard deviation `sd`."""
    if sd == 0:
        return 1.0
    words = pcg4d(seed + PURPOSE_YARN_COLOR, np.array([yarn]), np.array([part]), 0)
    normal = float(normal_pair(words[0], words[1])[0][0])
    spread = float(np.log1p(sd**2))
    return float(np.exp(np.sqrt(spread) * normal - 0.5 * spread))
