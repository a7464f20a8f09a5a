"""Our .npz of measurements: plain arrays with a schema name and version, nothing executable. Radians."""

from __future__ import annotations

import math
import zipfile
from pathlib import Path

import numpy as np

from weft.files.atomic import atomic_write
from weft.files.errors import InputError

from .measurements import Measurements

SCHEMA = "weft.measurements"
SCHEMA_VERSION = 1
NUMBERS = ("theta_i", "phi_i", "theta_o", "phi_o", "values")
OPTIONAL = ("sigma", "usable")
WORDS = ("quantity", "source", "channels")
KNOWN = ("schema", "schema_version", *NUMBERS, *OPTIONAL, *WORDS, "scale_known")
KINDS = {"schema_version": "iu", "usable": "b", "scale_known": "b"} | dict.fromkeys(("schema", *WORDS), "U")
"""numpy's letters for the kinds of value that an array may hold; all others hold float64."""
MAX_COMPRESSION = 1100
"""Deflate never does better than 1032 to 1; a member that claims more is damaged."""


def write_npz(measurements: Measurements, path: Path) -> None:
    """Write the file whole or not at all, every number bit for bit."""
    fields = {"schema": np.array(SCHEMA), "schema_version": np.array(SCHEMA_VERSION)}
    for name in (*NUMBERS, *OPTIONAL, *WORDS, "scale_known"):
        if (value := getattr(measurements, name)) is not None:
            fields[name] = np.asarray(value, dtype=np.str_ if name in WORDS else None)
    with atomic_write(path) as temporary, open(temporary, "wb") as file:
        np.savez_compressed(file, **fields)  # type: ignore[arg-type]  # numpy's stubs mix up its keywords


def read_npz(path: Path) -> Measurements:
    """Read a file written by `write_npz`; anything else is an `InputError` that names the file."""
    fields = _read_fields(path, KNOWN)
    if str(fields.get("schema")) != SCHEMA:
        raise InputError("not a file of measurements written by weft", path=path)
    if str(fields.get("schema_version")) != str(SCHEMA_VERSION):
        what = f"measurements of version {fields.get('schema_version')}; this weft reads {SCHEMA_VERSION}"
        raise InputError(what, path=path)
    for name in (*NUMBERS, *WORDS, "scale_known"):
        if name not in fields:
            raise InputError(f"measurements without '{name}'", path=path)
    if any(fields[name].ndim != 1 for name in (*NUMBERS[:4], "channels")) or not len(fields["theta_i"]):
        raise InputError("measurements with an empty or wrongly shaped array; is it damaged?", path=path)
    try:
        return Measurements(
            **{name: fields[name] for name in (*NUMBERS, *OPTIONAL) if name in fields},
            quantity=str(fields["quantity"]),
            source=str(fields["source"]),
            channels=tuple(str(name) for name in fields["channels"]),
            scale_known=bool(fields["scale_known"]),
        )
    except InputError as error:
        raise InputError(error.what, path=path, hint=error.hint) from None
    except (TypeError, ValueError, IndexError) as error:
        raise InputError("measurements with a field of the wrong kind; is it damaged?", path=path) from error


def _read_fields(path: Path, names: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Those of the named arrays that the archive has."""
    try:
        with zipfile.ZipFile(path) as archive:
            members = [info for info in archive.infolist() if info.filename.removesuffix(".npy") in names]
            return {info.filename.removesuffix(".npy"): _read_member(archive, info) for info in members}
    except FileNotFoundError:
        raise InputError("no such file", path=path) from None
    except Exception as error:  # damaged archives make zipfile and numpy raise nearly anything
        raise InputError("not a readable .npz file of measurements; is it damaged?", path=path) from error


def _read_member(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> np.ndarray:
    """One array, once its header agrees with the size of the file: nothing is allocated on a mere claim."""
    name = info.filename.removesuffix(".npy")
    if info.file_size > MAX_COMPRESSION * max(info.compress_size, 1):
        raise ValueError("implausible size")
    with archive.open(info) as member:
        if np.lib.format.read_magic(member) != (1, 0):
            raise ValueError("unknown array version")
        shape, _, dtype = np.lib.format.read_array_header_1_0(member)
        if dtype.kind not in KINDS.get(name, "f"):
            raise ValueError("another kind of value")
        if math.prod(shape) * dtype.itemsize > info.file_size:
            raise ValueError("more values announced than there are")
    with archive.open(info) as member:
        return np.lib.format.read_array(member, allow_pickle=False)
