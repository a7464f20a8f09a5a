"""ALTA's text of a BRDF (Belcour, Courtes, Pacanowski): `#DIM in out`, `#PARAM_IN`, `#PARAM_OUT`, rows.

A row holds the coordinates that `#PARAM_IN` names, then the values, then with `#VS 1` half an interval of
confidence for the value, taken as its standard deviation. Lines before and between that begin with `#` and
are no such key are remarks. Conventions as in ALTA's params.cpp: angles in radians from the normal z; in
half-angle coordinates the view is seen from the half vector; `COS_TH` puts light and view on the half vector.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from weft.files.atomic import atomic_write
from weft.files.errors import InputError
from weft.files.suggestions import did_you_mean

from .measurements import Array, Measurements
from .surface_directions import angles, vectors

Angles = tuple[Array, Array, Array, Array]
"""theta and phi toward the light, then toward the view, each of shape [N]; NaN where there is none."""
MAX_FILE_BYTES = 4 << 30
UNIT = 1e-6
"""How far from one the length of a vector may be."""
VALUES = {"INV_STERADIAN": 1, "RGB_COLOR": 3}
"""Kinds of values that can be read, and how many make one."""
KEYS = ("DIM", "PARAM_IN", "PARAM_OUT", "VS", "FORMAT")


def _from_half(theta_h: Array, phi_h: Array, theta_d: Array, phi_d: Array) -> Angles:
    """The view is d turned by theta_h about y, then by phi_h about z; the light mirrors it at the half."""
    d = vectors(theta_d, phi_d)
    x = np.cos(theta_h) * d[:, 0] + np.sin(theta_h) * d[:, 2]
    z = np.cos(theta_h) * d[:, 2] - np.sin(theta_h) * d[:, 0]
    cos_h, sin_h = np.cos(phi_h), np.sin(phi_h)
    view = np.stack([cos_h * x - sin_h * d[:, 1], sin_h * x + cos_h * d[:, 1], z], axis=1)
    return *angles(2.0 * np.cos(theta_d)[:, None] * vectors(theta_h, phi_h) - view), *angles(view)


def _from_cartesian(*columns: Array) -> Angles:
    """The view stands first. Vectors that are not of length one have no direction."""
    view, light = np.stack(columns[:3], axis=1), np.stack(columns[3:], axis=1)
    for direction in (view, light):
        direction[np.abs(np.linalg.norm(direction, axis=1) - 1.0) > UNIT] = np.nan
    return *angles(light), *angles(view)


def _cos_th(cosine: Array) -> Angles:
    theta, phi = np.arccos(cosine), np.zeros_like(cosine)
    return theta, phi, theta, phi


COORDINATES: dict[str, tuple[int, Callable[..., Angles]]] = {
    "COS_TH": (1, _cos_th),
    "RUSIN_TH_TD": (2, lambda h, d: _from_half(h, 0.0 * h, d, 0.0 * d + np.pi / 2)),
    "COS_TH_TD": (2, lambda h, d: _from_half(np.arccos(h), 0.0 * h, np.arccos(d), 0.0 * d)),
    "RUSIN_TH_TD_PD": (3, lambda h, d, phi_d: _from_half(h, 0.0 * h, d, phi_d)),
    "ISOTROPIC_TV_TL_DPHI": (3, lambda v, light, dphi: (light, dphi, v, 0.0 * v)),
    "RUSIN_TH_PH_TD_PD": (4, _from_half),
    "SPHERICAL_TL_PL_TV_PV": (4, lambda *columns: columns),
    "CARTESIAN": (6, _from_cartesian),
}
"""Number of coordinates, and the angles from them, by the names of `#PARAM_IN`."""


@dataclass
class _Header:
    """Keys of the header by name, each with its line; remarks above the rows."""

    keys: dict[str, tuple[int, str]] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class _Layout:
    """What the numbers of a row are."""

    inputs: int
    outputs: int
    has_interval: bool
    to_angles: Callable[..., Angles]


def read_alta(path: Path) -> Measurements:
    """Read a text .alta file. Raises `InputError` with the line of what is missing, wrong or damaged."""
    header = _Header()
    layout: _Layout | None = None
    rows: list[list[float]] = []
    lines: list[int] = []
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise InputError("over 4 GiB; not a file of measurements", path=path)
        with open(path, encoding="utf-8", errors="replace") as file:
            for number, line in enumerate(file, start=1):
                text = line.strip()
                if text.startswith("#"):
                    if layout is None:
                        _read_key(text, number, header)
                elif text:
                    layout = layout or _layout(header, path)
                    rows.append(_row(text, number, layout, path))
                    lines.append(number)
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", path=path) from None
    if layout is None:
        raise InputError("no rows of measurements in this file", path=path)
    return _measurements(np.array(rows), lines, layout, header, path)


def _read_key(text: str, number: int, header: _Header) -> None:
    words = text[1:].split(maxsplit=1)
    if text[1:2].isspace() or not words or words[0] not in KEYS:
        header.remarks += [text[1:].strip()] if text[1:].strip() and not text.startswith("#ALTA_") else []
    else:
        header.keys[words[0]] = (number, words[1] if len(words) > 1 else "")


def _layout(header: _Header, path: Path) -> _Layout:
    name, line = _key(header, "PARAM_IN", path)
    if name not in COORDINATES:
        what = f"coordinates '{name[:60]}' cannot be read{did_you_mean(name, COORDINATES)}"
        raise InputError(what, path=path, place=line)
    inputs, to_angles = COORDINATES[name]
    kind, line = _key(header, "PARAM_OUT", path)
    if kind not in VALUES:
        what = f"values of kind '{kind[:60]}' cannot be read{did_you_mean(kind, VALUES)}"
        raise InputError(what, path=path, place=line)
    dimensions, line = _key(header, "DIM", path)
    if dimensions.split() != [str(inputs), str(VALUES[kind])]:
        what = f"'{name}' and '{kind}' need '#DIM {inputs} {VALUES[kind]}', found '{dimensions[:60]}'"
        raise InputError(what, path=path, place=line)
    interval, line = _key(header, "VS", path) if "VS" in header.keys else ("0", 0)
    if interval not in ("0", "1") or (interval == "1" and VALUES[kind] > 1):
        what = (
            f"'#VS {interval[:60]}' with {VALUES[kind]} values cannot be read; '#VS 0', or '#VS 1' with one"
        )
        raise InputError(what, path=path, place=line)
    if "FORMAT" in header.keys and header.keys["FORMAT"][1] != "text":
        what = f"format '{header.keys['FORMAT'][1][:60]}' cannot be read, only text"
        raise InputError(what, path=path, place=header.keys["FORMAT"][0])
    return _Layout(inputs, VALUES[kind], interval == "1", to_angles)


def _key(header: _Header, name: str, path: Path) -> tuple[str, int]:
    """Text and line of a key that must be there."""
    if name not in header.keys:
        raise InputError(f"no line '#{name}' before the first row", path=path)
    line, text = header.keys[name]
    return text.strip(), line


def _row(text: str, number: int, layout: _Layout, path: Path) -> list[float]:
    words = text.split()
    needed = layout.inputs + layout.outputs + layout.has_interval
    if len(words) != needed:
        raise InputError(f"{len(words)} numbers in this row; need {needed}", path=path, place=number)
    try:
        row = [float(word) for word in words]
    except ValueError:
        row = [np.nan]
    if not np.isfinite(row).all():
        raise InputError("found what is no finite number", path=path, place=number)
    if layout.has_interval and row[-1] <= 0:
        raise InputError("half an interval must be positive", path=path, place=number)
    return row


def _measurements(
    rows: Array, lines: list[int], layout: _Layout, header: _Header, path: Path
) -> Measurements:
    with np.errstate(invalid="ignore", over="ignore"):
        directions = layout.to_angles(*rows[:, : layout.inputs].T)
        theta_i, phi_i, theta_o, phi_o = (np.array(column) for column in directions)
    most = np.max([np.abs(theta_i), np.abs(theta_o)], axis=0)
    around = np.max([np.abs(phi_i), np.abs(phi_o)], axis=0)
    fine = (most <= np.pi) & (around <= 2 * np.pi)
    if not fine.all():
        place = lines[int(np.argmin(fine))]
        raise InputError("these coordinates are of no direction", path=path, place=place)
    above = (np.minimum(theta_i, theta_o) >= 0) & (most <= np.pi / 2)
    end = layout.inputs + layout.outputs
    return Measurements(
        theta_i=theta_i,
        phi_i=phi_i,
        theta_o=theta_o,
        phi_o=phi_o,
        values=rows[:, layout.inputs : end].copy(),
        quantity="brdf",
        sigma=rows[:, end:].copy() if layout.has_interval else None,
        usable=None if above.all() else above,
        channels=("r", "g", "b") if layout.outputs == 3 else (),
        source="\n".join([f"ALTA file {path.name}", *header.remarks]),
    )


def write_alta(measurements: Measurements, path: Path) -> None:
    """Write in the coordinates `SPHERICAL_TL_PL_TV_PV`: usable rows, radians and values bit for bit.

    The sigma of one channel goes in as half an interval; of three it cannot and is an `InputError`.
    """
    channels = measurements.values.shape[1]
    if measurements.quantity != "brdf" or channels not in VALUES.values():
        raise InputError("an ALTA file holds a 'brdf' in one or three channels", path=path)
    if measurements.sigma is not None and channels > 1:
        raise InputError("an ALTA file holds sigma for one channel only", path=path)
    kind = next(name for name, count in VALUES.items() if count == channels)
    columns = [measurements.theta_i, measurements.phi_i, measurements.theta_o, measurements.phi_o]
    columns += [*measurements.values.T, *(() if measurements.sigma is None else measurements.sigma.T)]
    rows = np.stack(columns, axis=1)
    if measurements.usable is not None:
        rows = rows[measurements.usable]
    header = [f"# {line}" for line in measurements.source.splitlines()]
    header += ["#ALTA_BEGIN_HEADER", f"#DIM 4 {channels}", "#PARAM_IN SPHERICAL_TL_PL_TV_PV"]
    header += [f"#PARAM_OUT {kind}", f"#VS {int(measurements.sigma is not None)}", "#ALTA_END_HEADER"]
    with atomic_write(path) as temporary, open(temporary, "w", encoding="utf-8", newline="\n") as file:
        file.writelines(f"{line}\n" for line in header)
        file.writelines("\t".join(map(repr, row)) + "\n" for row in rows.tolist())
