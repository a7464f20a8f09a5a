"""From a few free numbers to all parameters of the model: bounds, fixed values, ties, and units.

All parameters stand in one vector: five widths [rad], fresnel_tt, the scale, then four colors with one entry
per channel; last, where they change with the angle, the widths and T for light along the fiber. What is free,
fixed or tied are arrays too, so that one compiled solver serves every choice.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from weft.fiber_model.scattering.azimuthal_table import nearest_width
from weft.fiber_model.scattering.phase_jax import LobeKinds, LobeParameters
from weft.files.errors import InputError

from .config import ABSORPTION_POWER, COLORS, GRAZING, WIDTHS, FitConfig, ParameterConfig

import jax  # isort: skip  after phase_jax, which switches it to 64 bits
import jax.numpy as jnp  # isort: skip

Array = NDArray[np.float64]

SHAPE_COUNT = len(WIDTHS)
AZIMUTHAL = slice(3, SHAPE_COUNT)
FRESNEL_TT, SCALE, FIRST_COLOR = SHAPE_COUNT, SHAPE_COUNT + 1, SHAPE_COUNT + 2
LIMITS = {"longitudinal": (0.5, 60.0), "azimuthal": (2.0, 300.0)}
"""Of the widths [deg], as `FiberScatteringParameters` checks them."""
WIDEST_ALONG_GRAZING = 45.0
SCALE_LIMITS = (1e-9, 1e9)


class Parameterization(NamedTuple):
    """Arrays over all parameters, shape [P]; angles in radians."""

    lower: Array
    upper: Array
    held: Array
    """Value of what is not free."""
    free: Array
    """1.0 where the fit may move the parameter, else 0.0."""
    tie_source: NDArray[np.int64]
    """Index of the parameter that this one follows; its own where it follows none."""
    tie_factor: Array
    tie_power: Array


def parameter_names(channels: int, *, grazing: bool = False) -> tuple[str, ...]:
    """In the order of the vector, as in parameter files: "color_tt.r", or "color_tt" for one channel."""
    suffixes = [f".{c}" for c in "rgb"] if channels == 3 else [""]
    colors = [name + suffix for name in COLORS for suffix in suffixes]
    return (*WIDTHS, "fresnel_tt", "scale", *colors, *(GRAZING if grazing else ()))


def grazing_slice(count: int) -> slice:
    """Of a vector of `count` parameters, the values for light along the fiber; empty where it has none.

    Seven parameters and four per channel, of which there are one or three: the length tells.
    """
    return slice(count - (len(GRAZING) if (count - FIRST_COLOR) % len(COLORS) else 0), count)


def color_slice(name: str, channels: int) -> slice:
    first = FIRST_COLOR + COLORS.index(name) * channels
    return slice(first, first + channels)


def build_parameterization(config: FitConfig, channels: int, *, scale_known: bool) -> Parameterization:
    """What the config asks for, or the ties that resolve the exact degeneracies where it says nothing."""
    lower, upper = _limits(channels, config.grazing)
    count = len(lower)
    result = Parameterization(
        lower, upper, np.ones(count), np.ones(count), np.arange(count), np.ones(count), np.ones(count)
    )
    asked = _with_defaults(config, scale_known)
    for name, choice in asked.items():
        _apply(result, name, choice, channels)
    if config.gray and channels == 3:
        _tie_channels(result)
    _hold_absent_lobes(result, config, channels)
    tied = result.tie_source != np.arange(count)
    if tied[result.tie_source[tied]].any():
        raise InputError("fit: a parameter is tied to one that is tied itself; tie both to the same one")
    result.free[tied] = 0.0
    return result


def _limits(channels: int, grazing: bool) -> tuple[Array, Array]:
    widths = np.radians([LIMITS[name.split("_")[0]] for name in WIDTHS])
    rest = np.array([(0.0, 1.0), SCALE_LIMITS, *[(0.0, 1.0)] * (len(COLORS) * channels)])
    along_fiber = np.concatenate([widths, [(0.0, 1.0)]])
    along_fiber[:3, 1] = np.radians(WIDEST_ALONG_GRAZING)
    lower, upper = np.concatenate([widths, rest, *([along_fiber] if grazing else [])]).T.copy()
    return lower, upper


def _with_defaults(config: FitConfig, scale_known: bool) -> dict[str, ParameterConfig]:
    asked: dict[str, ParameterConfig] = {"color_r": ParameterConfig(fixed=1.0)}
    if not config.brightest_tt:
        asked["color_trt"] = ParameterConfig(tie_to="color_tt", power=ABSORPTION_POWER)
    if scale_known:
        asked["scale"] = ParameterConfig(fixed=1.0)
    if not config.gamma_trt:
        asked["azimuthal_width_trt_deg"] = ParameterConfig(fixed=LIMITS["azimuthal"][1])
        if config.grazing:
            asked["azimuthal_width_trt_grazing_deg"] = ParameterConfig(fixed=LIMITS["azimuthal"][1])
    asked |= _widths_of_tables(config)
    return asked | dict(config.parameters)


def _widths_of_tables(config: FitConfig) -> dict[str, ParameterConfig]:
    """A lobe with a table has no width that data could tell: that of the nearest simple lobe is held."""
    asked: dict[str, ParameterConfig] = {}
    for name, table in config.tables.items():
        if name == "azimuthal_table_r":
            continue
        width = name.replace("table", "width")
        ends = {f"{width}_deg": 0} | ({f"{width}_grazing_deg": -1} if config.grazing else {})
        asked |= {
            key: ParameterConfig(fixed=math.degrees(nearest_width(table, i))) for key, i in ends.items()
        }
    return asked


def _entries(name: str, channels: int) -> list[int]:
    if name in COLORS:
        where = color_slice(name, channels)
        return list(range(where.start, where.stop))
    return [parameter_names(channels, grazing=True).index(name)]


def _apply(into: Parameterization, name: str, choice: ParameterConfig, channels: int) -> None:
    entries = _entries(name, channels)
    unit = math.pi / 180 if name.endswith("_deg") else 1.0
    if choice.fixed is not None:
        values = _per_entry(name, choice.fixed, len(entries))
        _check_within(into, name, [unit * value for value in values], entries, unit)
        into.held[entries] = [unit * value for value in values]
        into.free[entries] = 0.0
    if choice.tie_to is not None:
        into.tie_source[entries] = _entries(choice.tie_to, channels)
        into.tie_factor[entries] = choice.factor
        into.tie_power[entries] = choice.power
    for limit, bound in ((into.lower, choice.lower), (into.upper, choice.upper)):
        if bound is not None:
            _check_within(into, name, [unit * bound], entries[:1], unit)
            limit[entries] = unit * bound


def _per_entry(name: str, value: float | Sequence[float], count: int) -> list[float]:
    if isinstance(value, float | int):
        return [float(value)] * count
    if len(value) != count:
        raise InputError(f"fit: parameters.{name}.fixed has {len(value)} numbers; the data give it {count}")
    return [float(number) for number in value]


def _check_within(
    into: Parameterization, name: str, values: Sequence[float], entries: list[int], unit: float
) -> None:
    for value, entry in zip(values, entries, strict=True):
        low, high = into.lower[entry], into.upper[entry]
        if not low * (1 - 1e-12) <= value <= high * (1 + 1e-12):
            what = f"fit: parameters.{name}: {value / unit:g} is outside [{low / unit:g}, {high / unit:g}]"
            raise InputError(what)


def _tie_channels(into: Parameterization) -> None:
    """Gray: the green and blue entry of each color follow the red one, or what that follows."""
    for name in COLORS:
        where = color_slice(name, 3)
        red = where.start
        for array in (into.held, into.free, into.tie_source, into.tie_factor, into.tie_power):
            array[where] = array[red]


def _hold_absent_lobes(into: Parameterization, config: FitConfig, channels: int) -> None:
    """Where no light is left for a lobe, its width and color mean nothing: hold them."""
    fixed = into.free == 0
    along_fiber = range(len(fixed))[grazing_slice(len(fixed))]
    ends = (FRESNEL_TT, *along_fiber[-1:])
    no_trt = all(fixed[end] and into.held[end] == 1.0 for end in ends)
    if no_trt:
        if along_fiber:
            into.free[[along_fiber[2], along_fiber[4]]] = 0.0
            into.held[[along_fiber[2], along_fiber[4]]] = np.radians(24.0)
        for entry in (2, 4, *_entries("color_trt", channels)):
            into.tie_source[entry] = entry
            into.free[entry] = 0.0
        into.held[2] = np.clip(np.radians(24.0), into.lower[2], into.upper[2])


def expand(parameterization: Parameterization, x: jax.Array) -> jax.Array:
    """All parameters, shape [P], from the free entries of `x`, shape [P]; the rest of `x` is ignored."""
    own = jnp.where(jnp.asarray(parameterization.free) > 0, x, parameterization.held)
    tied = own[parameterization.tie_source]
    return jnp.asarray(parameterization.tie_factor) * tied**parameterization.tie_power


def lobe_parameters(full: jax.Array, channels: int) -> LobeParameters:
    widths = dict(zip((name.removesuffix("_deg") for name in WIDTHS), full[:SHAPE_COUNT], strict=True))
    colors = {name: full[color_slice(name, channels)] for name in COLORS}
    values = full[grazing_slice(len(full))]
    along_fiber = dict(zip((name.removesuffix("_deg") for name in GRAZING), values, strict=False))
    return LobeParameters(**widths, **colors, fresnel_tt=full[FRESNEL_TT], **along_fiber)


def lobe_kinds(config: FitConfig) -> LobeKinds:
    return LobeKinds(config.longitudinal, config.azimuthal, not config.gamma_trt, config.grazing)


def widths_from_unbounded(parameterization: Parameterization, z: jax.Array) -> jax.Array:
    """Widths within their bounds from any z, shape [5]: logistic on the logarithm of the width.

    One unit of z changes a width by about its own size, as a solver with unscaled damping needs.
    """
    low, high = (jnp.log(limit[:SHAPE_COUNT]) for limit in (parameterization.lower, parameterization.upper))
    return jnp.exp(low + (high - low) * jax.nn.sigmoid(z))


def to_external_units(values: Array) -> Array:
    """Angles to degrees, along the last axis."""
    converted = np.array(values, dtype=np.float64)
    along_fiber = grazing_slice(converted.shape[-1])
    for widths in (slice(SHAPE_COUNT), slice(along_fiber.start, along_fiber.start + SHAPE_COUNT)):
        converted[..., widths] = np.degrees(converted[..., widths])
    return converted
