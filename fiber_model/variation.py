"""How a yarn varies along its length: thickness noise, slubs and color noise, functions of (seed, yarn, s).

Not in Zhao, Luan and Bala 2016, who name it as what their model lacks. Nothing is carried from place to
place, so any part of a yarn made alone equals the whole; on closed yarns all three are periodic.

Noise: independent normals n_j at places x_j = j h, h about half the correlation length L, summed with
Gaussian weights, g(s) = sum_j w_j n_j / sqrt(sum_j w_j^2), w_j = exp(-2 (s - x_j)^2 / L^2). Its variance is
1 at every s and its correlation exp(-d^2 / L^2). A factor of mean 1 and standard deviation sd is exp(k g -
k^2 / 2) with k^2 = ln(1 + sd^2), which is never negative.

Slubs: a Poisson process, drawn cell by cell, of smooth bumps 1 + (t - 1) cos^2(pi (s - c) / l) of length l
and peak t; where they overlap, what they add is added.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .config import VariationConfig
from .counter_random import (
    LARGEST_NORMAL,
    PURPOSE_COLOR_NOISE,
    PURPOSE_SLUB,
    PURPOSE_SLUB_COUNT,
    PURPOSE_THICKNESS_NOISE,
    normal_pair,
    pcg4d,
    poisson,
    uniform,
)

WINDOW = 5
"""Normals on each side that count: the next one has a weight below exp(-18)."""


@dataclass(frozen=True)
class YarnPlace:
    """Which yarn is meant, and whether places are counted around a loop."""

    yarn: int
    length: float
    """[mm]"""
    closed: bool


@dataclass(frozen=True)
class Slubs:
    """Slubs of one yarn: centers and half lengths [mm], and what they add to the thickness there."""

    center: np.ndarray
    half_length: np.ndarray
    added: np.ndarray


def thickness(seed: int, place: YarnPlace, s: np.ndarray, config: VariationConfig) -> np.ndarray:
    """Thickness over the yarn's own at ascending arc lengths `s` [mm], float64, shape of `s`."""
    factor = noise_factor(
        seed + PURPOSE_THICKNESS_NOISE, place, s, sd=config.thickness_sd, length_mm=config.thickness_length_mm
    )
    return factor * (1.0 + slub_sum(draw_slubs(seed, place, config), place, s))


def lightness(seed: int, place: YarnPlace, s: np.ndarray, config: VariationConfig) -> np.ndarray:
    """Factor on the color at arc lengths `s` [mm], of mean 1; it may pass 1."""
    return noise_factor(
        seed + PURPOSE_COLOR_NOISE, place, s, sd=config.color_sd, length_mm=config.color_length_mm
    )


def noise_factor(seed: int, place: YarnPlace, s: np.ndarray, *, sd: float, length_mm: float) -> np.ndarray:
    """Lognormal noise of mean 1 and standard deviation `sd`."""
    if sd == 0:
        return np.ones(len(s))
    spread = np.log1p(sd**2)
    return np.exp(np.sqrt(spread) * smooth_normal(seed, place, s, length_mm) - 0.5 * spread)


def smooth_normal(seed: int, place: YarnPlace, s: np.ndarray, length_mm: float) -> np.ndarray:
    """A standard normal at each arc length, correlated as exp(-d^2 / length_mm^2)."""
    count = max(round(2.0 * place.length / length_mm), 1)
    spacing = place.length / count if place.closed else 0.5 * length_mm
    nearest = np.floor(s / spacing).astype(np.int64)
    if place.closed and count < 2 * WINDOW + 2:
        return _around_short_loop(seed, place, s, length_mm, count)
    first = int(nearest.min(initial=0)) - WINDOW
    lattice = np.arange(first, int(nearest.max(initial=0)) + WINDOW + 2)
    normals = _lattice_normals(seed, place.yarn, lattice % count if place.closed else lattice)
    total, square = np.zeros(len(s)), np.zeros(len(s))
    for step in range(-WINDOW, WINDOW + 2):
        at = nearest + step
        weight = np.exp(-2.0 * ((s - at * spacing) / length_mm) ** 2)
        total += weight * normals[at - first]
        square += weight**2
    return total / np.sqrt(square)


def _around_short_loop(
    seed: int, place: YarnPlace, s: np.ndarray, length_mm: float, count: int
) -> np.ndarray:
    """The same where the window goes around the loop more than once: weights are added up first."""
    lattice = np.arange(count)
    spacing = place.length / count
    turns = np.arange(-2, 3) if count > WINDOW else np.arange(-WINDOW - 1, WINDOW + 2)
    distance = s[:, None, None] - (lattice[:, None] + turns * count) * spacing
    weight = np.exp(-2.0 * (distance / length_mm) ** 2).sum(axis=2)
    normals = _lattice_normals(seed, place.yarn, lattice)
    return (weight * normals).sum(axis=1) / np.sqrt((weight**2).sum(axis=1))


def _lattice_normals(seed: int, yarn: int, index: np.ndarray) -> np.ndarray:
    words = pcg4d(seed, yarn, index, 0)
    return normal_pair(words[0], words[1])[0].astype(np.float64)


def draw_slubs(seed: int, place: YarnPlace, config: VariationConfig) -> Slubs:
    """All slubs of a yarn in order of their cells; of an open one also those that reach in from outside."""
    if config.slubs_per_m == 0:
        return Slubs(np.empty(0), np.empty(0), np.empty(0))
    cell_mm = 0.5 * (config.slub_length_mm + LARGEST_NORMAL * config.slub_length_sd_mm)
    if place.closed:
        count = max(int(place.length / cell_mm), 1)
        cell_mm, cells = place.length / count, np.arange(count)
    else:
        cells = np.arange(-1, int(place.length / cell_mm) + 2)
    mean = np.array(1e-3 * config.slubs_per_m * cell_mm)
    counts = poisson(mean, seed + PURPOSE_SLUB_COUNT, place.yarn, cells)
    cell = np.repeat(cells, counts)
    number = np.arange(len(cell)) - np.repeat(np.cumsum(counts) - counts, counts)
    words = pcg4d(seed + PURPOSE_SLUB, place.yarn, cell, number)
    length_normal, peak_normal = (value.astype(np.float64) for value in normal_pair(words[1], words[2]))
    length = config.slub_length_mm + config.slub_length_sd_mm * length_normal
    return Slubs(
        center=(cell + uniform(words[0])) * cell_mm,
        # the lower bound keeps the bump defined; on a loop a slub goes around at most once
        half_length=np.clip(0.5 * length, 0.05 * config.slub_length_mm, cell_mm),
        added=np.maximum(config.slub_thickness - 1.0 + config.slub_thickness_sd * peak_normal, 0.0),
    )


def slub_sum(slubs: Slubs, place: YarnPlace, s: np.ndarray) -> np.ndarray:
    """What slubs add to the thickness at ascending arc lengths `s`, in an order that `s` has no part in."""
    added = np.zeros(len(s))
    for shift in (-place.length, 0.0, place.length) if place.closed else (0.0,):
        center = slubs.center + shift
        begin = np.searchsorted(s, center - slubs.half_length)
        end = np.searchsorted(s, center + slubs.half_length)
        for i in np.flatnonzero(end > begin):
            part = slice(begin[i], end[i])
            wave = np.cos(0.5 * np.pi * (s[part] - center[i]) / slubs.half_length[i])
            added[part] += slubs.added[i] * wave**2
    return added
