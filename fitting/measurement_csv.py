"""Our .csv of measurements: `# quantity: …` and `# scale: …`, a line of column names, a row per direction.

Angles stand in degrees, in the shortest of a few texts that read back to the same radians: ten decimals,
a float64, or 21 digits where no float64 in degrees leads there (one in eight of random angles). Up to 17
digits are read as `np.deg2rad` of a float64, more in extended precision and rounded once. So radians
survive writing and reading bit for bit where C has a long double wider than a double (Linux on x86-64 and
ARM), and to one unit in the last place elsewhere. Values and sigmas are float64 in the shortest text that
reads back to them.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from weft.files.atomic import atomic_write
from weft.files.errors import InputError
from weft.files.suggestions import did_you_mean

from .measurements import QUANTITIES, Array, Measurements

FIRST_LINE = "weft measurements, version 1"
ANGLES = ("theta_i", "phi_i", "theta_o", "phi_o")
ANGLE_COLUMNS = tuple(f"{angle}_deg" for angle in ANGLES)
SCALES = {"known": True, "free": False}
CHANNEL_NAME = re.compile(r"(?!\d+$)[A-Za-z0-9_.+-]+")
DIGITS_OF_A_FLOAT = 17
MAX_FILE_BYTES = 4 << 30


def write_csv(measurements: Measurements, path: Path) -> None:
    """Write the file whole or not at all. Channels need names of letters, digits and `_.+-`."""
    channels = _channel_names(measurements, path)
    columns = {f"{angle}_deg": degrees_text(getattr(measurements, angle)) for angle in ANGLES}
    columns |= {f"value{name}": _texts(measurements.values[:, i]) for i, name in enumerate(channels)}
    if measurements.sigma is not None:
        columns |= {f"sigma{name}": _texts(measurements.sigma[:, i]) for i, name in enumerate(channels)}
    if measurements.usable is not None:
        columns["usable"] = [str(int(usable)) for usable in measurements.usable]
    scale = "known" if measurements.scale_known else "free"
    header = [FIRST_LINE, f"quantity: {measurements.quantity}", f"scale: {scale}"]
    header += [f"source: {line}" for line in measurements.source.splitlines()]
    with atomic_write(path) as temporary, open(temporary, "w", encoding="utf-8", newline="\n") as file:
        file.writelines(f"# {line}\n" for line in header)
        file.write(",".join(columns) + "\n")
        file.writelines(",".join(row) + "\n" for row in zip(*columns.values(), strict=True))


def _channel_names(measurements: Measurements, path: Path) -> list[str]:
    """What follows `value` and `sigma` in the names of the columns."""
    count = measurements.values.shape[1]
    for name in measurements.channels:
        if not CHANNEL_NAME.fullmatch(name):
            what = f"channel name '{name}' cannot stand in a .csv; use letters, digits and '_.+-'"
            raise InputError(what, path=path)
    if measurements.channels:
        return [f"_{name}" for name in measurements.channels]
    return [""] if count == 1 else [f"_{index + 1}" for index in range(count)]


def _texts(numbers: Array) -> list[str]:
    return [repr(number) for number in numbers.tolist()]


def degrees_text(radians: Array) -> list[str]:
    """Text in degrees that `radians_from` turns into these very radians."""
    exact = np.rad2deg(radians.astype(np.longdouble))
    texts = [repr(round(float(angle), 10)) for angle in exact]
    for finer in (lambda angle: repr(float(angle)), _all_digits):
        for index in np.flatnonzero(radians_from(texts) != radians):
            texts[index] = finer(exact[index])
    return texts


def _all_digits(angle: np.longdouble) -> str:
    return np.format_float_scientific(angle, unique=False, precision=20)


def radians_from(texts: Iterable[str]) -> Array:
    """Radians of angles written in degrees. Raises `ValueError` for what is no number."""
    return np.array([_radians(text) for text in texts], dtype=np.float64)


def _radians(text: str) -> float:
    digits = text.lower().partition("e")[0].replace(".", "").strip().lstrip("+-0")
    if len(digits) > DIGITS_OF_A_FLOAT:
        return float(np.deg2rad(np.longdouble(text.strip())))
    return float(np.deg2rad(float(text)))


@dataclass
class _Header:
    """What stands above the rows."""

    notes: dict[str, tuple[int, str]] = field(default_factory=dict)
    """Line and text of `# key: text`, by key."""
    source: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class _Columns:
    """Where each column stands in a row."""

    names: list[str]
    angles: list[int]
    values: list[int]
    sigmas: list[int]
    usable: int | None
    channels: tuple[str, ...]


def read_csv(path: Path) -> Measurements:
    """Read such a file, written by weft or by hand. Raises `InputError` with line and column."""
    header, columns = _Header(), None
    rows: list[list[float]] = []
    angles: list[float] = []
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise InputError("over 4 GiB; not a file of measurements", path=path)
        with open(path, encoding="utf-8-sig", errors="replace") as file:
            for number, line in enumerate(file, start=1):
                text = line.strip()
                if text.startswith("#"):
                    _read_note(text, number, header, path)
                elif text and columns is None:
                    columns = _columns(text, number, path)
                elif text and columns is not None:
                    row, directions = _row(text, number, columns, path)
                    rows.append(row)
                    angles += directions
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", path=path) from None
    if columns is None or not rows:
        raise InputError("no rows of measurements in this file", path=path)
    return _measurements(header, columns, np.array(rows), np.array(angles).reshape(-1, 4), path)


def _read_note(text: str, number: int, header: _Header, path: Path) -> None:
    key, colon, rest = text[1:].strip().partition(":")
    if key.startswith("weft measurements") and key != FIRST_LINE:
        raise InputError(f"'{key}' found; this weft reads '{FIRST_LINE}'", path=path, place=number)
    if colon and key == "source":
        header.source.append(rest.strip())
    elif colon and key not in header.notes:
        header.notes[key] = (number, rest.strip())


def _columns(text: str, number: int, path: Path) -> _Columns:
    names = [name.strip() for name in text.split(",")]
    values = [index for index, name in enumerate(names) if re.match("value(_|$)", name)]
    suffixes = [names[index].removeprefix("value") for index in values]
    known = [*ANGLE_COLUMNS, *(f"value{suffix}" for suffix in suffixes)]
    known += [*(f"sigma{suffix}" for suffix in suffixes), "usable"]
    what = ""
    for name in names:
        if name not in known:
            what = f"unknown column '{name[:60]}'{did_you_mean(name, [*known, 'value'])}"
        elif names.count(name) > 1:
            what = f"column '{name}' stands twice"
        if what:
            raise InputError(what, path=path, place=number)
    sigmas = [f"sigma{suffix}" for suffix in suffixes if any(name.startswith("sigma") for name in names)]
    for name in (*ANGLE_COLUMNS, *sigmas):
        if name not in names:
            raise InputError(f"no column '{name}'", path=path, place=number)
    if not values:
        raise InputError("no column 'value', nor 'value_' with a channel's name", path=path, place=number)
    unnamed = suffixes in ([""], [f"_{index + 1}" for index in range(len(suffixes))])
    return _Columns(
        names=names,
        angles=[names.index(name) for name in ANGLE_COLUMNS],
        values=values,
        sigmas=[names.index(name) for name in sigmas],
        usable=names.index("usable") if "usable" in names else None,
        channels=() if unnamed else tuple(suffix[1:] for suffix in suffixes),
    )


def _row(text: str, number: int, columns: _Columns, path: Path) -> tuple[list[float], list[float]]:
    """The numbers of a row in the order of its columns, and its four angles in radians."""
    words = text.split(",")
    if len(words) != len(columns.names):
        what = f"{len(words)} numbers in this row, but {len(columns.names)} columns"
        raise InputError(what, path=path, place=number)
    row: list[float] = []
    for name, word in zip(columns.names, words, strict=True):
        try:
            row.append(float(word))
        except ValueError:
            row.append(np.nan)
        _refuse_number(name, row[-1], word, number, path)
    return row, [_radians(words[index]) for index in columns.angles]


def _refuse_number(name: str, found: float, word: str, number: int, path: Path) -> None:
    """Raise where a number cannot stand in the column of this name."""
    need = ""
    if not np.isfinite(found) or "_" in word or not word.isascii():
        need = "a finite number"
    elif name.startswith("theta") and abs(found) > 90.0:
        need = "degrees from -90 to 90"
    elif name.startswith("phi") and abs(found) > 360.0:
        need = "degrees from -360 to 360"
    elif name.startswith("sigma") and found <= 0.0:
        need = "a positive number"
    elif name == "usable" and found not in (0.0, 1.0):
        need = "0 or 1"
    if need:
        shown = word.strip()[:60].encode("ascii", "backslashreplace").decode()
        raise InputError(f"{name}: found '{shown}'; need {need}", path=path, place=number)


def _measurements(
    header: _Header, columns: _Columns, rows: Array, radians: Array, path: Path
) -> Measurements:
    theta_i, phi_i, theta_o, phi_o = radians.T.copy()
    quantity = _note(header, "quantity", QUANTITIES, path)
    scale = _note(header, "scale", list(SCALES), path)
    if quantity == "brdf" and (radians[:, (0, 2)] < 0).any():
        raise InputError("theta of a 'brdf' is measured from the normal: 0 to 90 degrees", path=path)
    return Measurements(
        theta_i=theta_i,
        phi_i=phi_i,
        theta_o=theta_o,
        phi_o=phi_o,
        values=rows[:, columns.values],
        quantity=quantity,
        sigma=rows[:, columns.sigmas] if columns.sigmas else None,
        scale_known=SCALES[scale],
        usable=None if columns.usable is None else rows[:, columns.usable] == 1.0,
        channels=columns.channels,
        source="\n".join(header.source),
    )


def _note(header: _Header, key: str, known: Sequence[str], path: Path) -> str:
    if key not in header.notes:
        what = f"no line '# {key}: {' | '.join(known)}'"
        raise InputError(what + did_you_mean(key, header.notes, list_known=0), path=path)
    line, text = header.notes[key]
    if text not in known:
        raise InputError(f"{key} '{text[:60]}'{did_you_mean(text, known)}", path=path, place=line)
    return text
