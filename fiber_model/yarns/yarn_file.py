"""Yarn sets as .npz files: plain arrays with a schema name and version, nothing executable."""

from __future__ import annotations

import math
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from weft.files.atomic import atomic_write
from weft.files.errors import InputError

from .yarns import YarnSet

SCHEMA = "weft.yarns"
SCHEMA_VERSION = 1
REQUIRED = ("points", "offsets", "closed", "radius", "yarn_type", "type_names")
OPTIONAL = ("twist", "surface_uv", "row")
KINDS = {"schema": "U", "type_names": "U", "offsets": "iu", "yarn_type": "iu", "row": "iu"}
"""numpy's letters for the kinds of value that an array may hold; all others hold numbers."""
MAX_COMPRESSION = 1100
"""Deflate never does better than 1032 to 1; a member that claims more is damaged."""


def save_yarns(yarns: YarnSet, path: str | Path) -> None:
    """Write the set; the file appears whole or not at all."""
    fields: dict[str, Any] = {"schema": np.array(SCHEMA), "schema_version": np.array(SCHEMA_VERSION)}
    for name in REQUIRED + OPTIONAL:
        if (value := getattr(yarns, name)) is not None:
            fields[name] = np.asarray(value)
    with atomic_write(path) as temporary, open(temporary, "wb") as file:
        np.savez(file, **fields)


def load_yarns(path: str | Path) -> YarnSet:
    """Read a file written by `save_yarns`; anything else is an `InputError` that names the file."""
    path = Path(path)
    fields = _read_fields(path)
    _check_schema(fields, path)
    fields["type_names"] = tuple(str(name) for name in np.atleast_1d(fields["type_names"]))
    try:
        return YarnSet(**{name: fields[name] for name in REQUIRED + OPTIONAL if name in fields})
    except (TypeError, ValueError) as error:
        raise InputError(f"yarn file with a field of the wrong kind: {error}", path=path) from error
    except InputError as error:
        raise InputError(error.what, path=path, hint=error.hint) from None


def _check_schema(fields: dict[str, Any], path: Path) -> None:
    """Refuse files of another kind or of a later version."""
    if str(fields.get("schema")) != SCHEMA:
        raise InputError("not a yarn file written by weft", path=path)
    version = fields.get("schema_version")
    if str(version) != str(SCHEMA_VERSION):
        raise InputError(f"yarn file of version {version}; this weft reads {SCHEMA_VERSION}", path=path)
    for name in REQUIRED:
        if name not in fields:
            raise InputError(f"yarn file without '{name}'", path=path)


def _read_fields(path: Path) -> dict[str, Any]:
    """The known arrays of the archive, whatever they hold."""
    known = ("schema", "schema_version", *REQUIRED, *OPTIONAL)
    try:
        with zipfile.ZipFile(path) as archive:
            members = [info for info in archive.infolist() if info.filename.removesuffix(".npy") in known]
            return {info.filename.removesuffix(".npy"): _read_member(archive, info) for info in members}
    except FileNotFoundError:
        raise InputError("no such file", path=path) from None
    except Exception as error:  # damaged archives make zipfile and numpy raise nearly anything
        raise InputError("not a readable .npz yarn file; is it damaged?", path=path) from error


def _read_member(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> np.ndarray:
    """One array, once its header agrees with the size of the file: nothing is allocated on a mere claim."""
    if info.file_size > MAX_COMPRESSION * max(info.compress_size, 1):
        raise ValueError("implausible size")
    with archive.open(info) as member:
        version = np.lib.format.read_magic(member)
        if version != (1, 0):
            raise ValueError("unknown array version")
        shape, _, dtype = np.lib.format.read_array_header_1_0(member)
        if dtype.kind not in KINDS.get(info.filename.removesuffix(".npy"), "biuf"):
            raise ValueError("another kind of value")
        if math.prod(shape) * dtype.itemsize > info.file_size:
            raise ValueError("more values announced than there are")
    with archive.open(info) as member:
        return np.lib.format.read_array(member, allow_pickle=False)
