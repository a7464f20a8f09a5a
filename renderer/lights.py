"""All lights as one alias table (Walker 1977), in the layout of shaders/light/lights.glsl."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from weft.files.errors import InputError

from .config import DaylightLight, DirectionalLight, Light
from .daylight import sun_light
from .environment import LUMINANCE, build_environment, texel_solid_angles

MAX_DIRECTIONAL_LIGHTS = 16
FEW_PAIRS = 64
"""Below so many at once, `alias_table` lets them give several times."""
MANY_GIFTS = 1 << 14
"""That it tries at once."""


@dataclass(frozen=True)
class LocalValues:
    """Of lights that stand somewhere; float64, shape [n, 3]."""

    values: np.ndarray
    """Radiance, or irradiance at a distance of one voxel."""
    fluence: np.ndarray
    """About how much of it reaches the scene."""


@dataclass(frozen=True)
class LightTable:
    """Entries of texels, of directional lights, one without light, of local ones; see `build_light_table`."""

    environment: np.ndarray
    """Radiance, float32, shape [rows, 2 rows, 3]."""
    directions: np.ndarray
    """Toward the directional lights, float32, shape [16, 4], unused rows zero."""
    entries: np.ndarray
    """(radiance or irradiance, pdf [1/sr] or chance), (threshold, alias as bits, 0, 0); float32, [n, 8]."""


def build_light_table(
    lights: Sequence[Light],
    camera_axes: np.ndarray,
    local: LocalValues | None = None,
    *,
    compensated: bool = False,
) -> LightTable:
    """The table of all lights; each is chosen by its luminous fluence.

    camera_axes: rows right, up, toward the camera.
    compensated: of the environment only what is brighter than its mean is sampled, the rest is left to the
    phase function, and as often as that rest carries the light no light is chosen at all. Unbiased where
    scattered rays find the environment too. MIS compensation (Karlík et al. 2019), densities not scaled up.
    """
    local = local or LocalValues(np.zeros((0, 3)), np.zeros((0, 3)))
    environment = build_environment(lights, camera_axes)
    directional = [light for light in lights if isinstance(light, DirectionalLight)]
    directional += [sun_light(light) for light in lights if isinstance(light, DaylightLight) and light.sun]
    if len(directional) > MAX_DIRECTIONAL_LIGHTS:
        raise InputError(
            f"render.lights: {len(directional)} directional lights; at most {MAX_DIRECTIONAL_LIGHTS}."
        )
    rows = len(environment)
    solid_angle = np.repeat(texel_solid_angles(rows), 2 * rows)
    irradiance = np.array([light.irradiance for light in directional]).reshape(-1, 3)
    nothing = np.zeros((1, 3))
    values = np.concatenate([environment.reshape(-1, 3), irradiance, nothing, local.values], dtype=np.float64)
    measure = np.concatenate([solid_angle, np.ones(len(directional) + 1 + len(local.values))])
    sampled, left = _sampled_luminance(environment, solid_angle) if compensated else (None, 0.0)
    luminance = values[: len(solid_angle)] @ LUMINANCE if sampled is None else sampled
    fluence = np.concatenate(
        [luminance * solid_angle, irradiance @ LUMINANCE, [left], local.fluence @ LUMINANCE]
    )
    # a black scene still needs a table; its entries carry nothing
    probability = fluence / fluence.sum() if fluence.sum() > 0 else np.full(len(fluence), 1 / len(fluence))
    threshold, alias = alias_table(probability)
    entries = np.zeros((len(values), 8), np.float32)
    entries[:, :3] = values
    entries[:, 3] = probability / measure
    entries[:, 4] = threshold
    entries[:, 5] = alias.astype(np.uint32).view(np.float32)
    directions = np.zeros((MAX_DIRECTIONAL_LIGHTS, 4), np.float32)
    directions[len(directional) :, 1] = 1  # of the entry without light
    for index, light in enumerate(directional):
        directions[index, :3] = _world_direction(light, camera_axes)
    return LightTable(environment, directions, entries)


def _sampled_luminance(environment: np.ndarray, solid_angle: np.ndarray) -> tuple[np.ndarray, float]:
    """What of each texel is brighter than the mean, shape [n], and the fluence of all the rest."""
    luminance = environment.reshape(-1, 3).astype(np.float64) @ LUMINANCE
    # sums, no dot products: those of a BLAS with threads differ in their last digits by the number of cores
    mean = (luminance * solid_angle).sum() / solid_angle.sum()
    sampled = np.maximum(luminance - mean * (1 + 1e-6), 0)  # of a constant, rounding is not light
    return sampled, float(((luminance - sampled) * solid_angle).sum())


def _world_direction(light: DirectionalLight, camera_axes: np.ndarray) -> np.ndarray:
    direction = np.array(light.direction)
    length = np.linalg.norm(direction)
    if not length > 0:
        raise InputError("render.lights: a directional light has direction zero.")
    direction = direction / length
    return direction @ camera_axes if light.relative_to == "camera" else direction


def alias_table(probability: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Thresholds [1] and aliases: entry i stands for itself with chance threshold[i], else for alias[i].

    Vose 1991, vectorized: every small entry takes its missing part from a large one, as many at once as there
    are of both; a large one that became small joins the small ones. Where only few are large, each gives
    several times in turn, until one becomes small. The order of all gifts is that of two queues.
    """
    count = len(probability)
    weight = np.asarray(probability, np.float64) * count
    threshold, alias = np.ones(count), np.arange(count)
    small, large = np.flatnonzero(weight < 1), np.flatnonzero(weight >= 1)
    while pairs := min(len(small), len(large)):
        turns = min(len(small) // pairs, MANY_GIFTS // pairs) if pairs < FEW_PAIRS else 1
        givers = large[:pairs]
        left = _left_after_turns(weight[givers], 1 - weight[small[: turns * pairs]])
        taken, small = np.split(small, [(len(left) - 1) * pairs])
        threshold[taken], alias[taken] = weight[taken], np.tile(givers, len(left) - 1)
        weight[givers] = left[-1]
        still_large = left[-1] >= 1
        small = np.concatenate([small, givers[~still_large]])
        large = np.concatenate([large[pairs:], givers[still_large]])
    # what is left differs from 1 by rounding only
    return threshold, alias


def _left_after_turns(weight: np.ndarray, gifts: np.ndarray) -> np.ndarray:
    """Weights of large entries before and after each turn, until one is small; shape [1 + turns, n]."""
    left = np.subtract.accumulate(np.concatenate([weight[None], gifts.reshape(-1, len(weight))]))
    became_small = np.flatnonzero((left[1:] < 1).any(axis=1))
    return left[: became_small[0] + 2] if len(became_small) else left
