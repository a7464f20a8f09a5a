"""Measurements to and from files: one entry for all formats, told apart by the suffix."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from weft.files.errors import InputError
from weft.files.suggestions import did_you_mean

from .alta import read_alta, write_alta
from .measurement_csv import read_csv, write_csv
from .measurement_npz import read_npz, write_npz
from .measurements import Measurements
from .merl_measurements import read_merl_measurements, write_merl_measurements
from .rgl_measurements import read_rgl_measurements
from .utia import read_utia, write_utia

READERS: dict[str, Callable[[Path], Measurements]] = {
    ".csv": read_csv,
    ".npz": read_npz,
    ".binary": read_merl_measurements,
    ".bin": read_utia,
    ".bsdf": read_rgl_measurements,
    ".alta": read_alta,
}
WRITERS: dict[str, Callable[[Measurements, Path], None]] = {
    ".csv": write_csv,
    ".npz": write_npz,
    ".binary": write_merl_measurements,
    ".bin": write_utia,
    ".alta": write_alta,
}


def load_measurements(path: str | Path) -> Measurements:
    """Read a file of measurements in the format that its suffix names.

    Raises `InputError`, one line with the path and, where there is one, the line or byte.
    """
    path = Path(path)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        what = f"measurements cannot be read from '{path.suffix}' files"
        raise InputError(what + did_you_mean(path.suffix, READERS), path=path)
    return reader(path)


def save_measurements(measurements: Measurements, path: str | Path) -> None:
    """Write .csv (degrees, for people) or .npz (radians), which read back to the same bits; or a table.

    The formats of others hold some measurements only; what does not fit is an `InputError`.
    """
    path = Path(path)
    writer = WRITERS.get(path.suffix.lower())
    if writer is None:
        what = f"measurements cannot be written to '{path.suffix}' files"
        raise InputError(what + did_you_mean(path.suffix, WRITERS), path=path)
    writer(measurements, path)
