"""scattering.json: the scattering parameters of a job's media, as numbers that read back exactly."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import MISSING, asdict, fields
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from weft.fiber_model.scattering.parameters import FiberScatteringParameters, Table
from weft.files.atomic import atomic_write
from weft.files.errors import InputError
from weft.files.json_file import read_json
from weft.renderer.media_config import HenyeyGreensteinScattering, IsotropicScattering, SggxScattering
from weft.renderer.simple_phases import HenyeyGreensteinPhase, IsotropicPhase, SggxPhase, SimplePhase

FORMAT = "weft scattering parameters"
FORMAT_VERSION = 1
MAX_BYTES = 2**24
Scattering = FiberScatteringParameters | SimplePhase
SIMPLE: dict[str, Any] = {
    "isotropic": IsotropicScattering,
    "henyey_greenstein": HenyeyGreensteinScattering,
    "sggx": SggxScattering,
}
KIND_OF: dict[type, str] = {
    IsotropicPhase: "isotropic",
    HenyeyGreensteinPhase: "henyey_greenstein",
    SggxPhase: "sggx",
}
EVERY_MEDIUM = "*"
"""The entry for the media that have none of their own."""


def write_scattering(path: Path, media: Mapping[str, Scattering]) -> None:
    document = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "units": {"angles": "rad", "colors": "linear RGB"},
        "media": {name: _document(parameters) for name, parameters in media.items()},
    }
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(document, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def read_scattering(path: Path) -> dict[str, Scattering]:
    """Raises `InputError` where the file is not one of ours."""
    document = read_json(path, max_bytes=MAX_BYTES, what="scattering parameters")
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise InputError("holds no scattering parameters of weft", path=path)
    if document.get("format_version") != FORMAT_VERSION:
        found = document.get("format_version")
        raise InputError(f"has format version {found}; this weft reads {FORMAT_VERSION}", path=path)
    media = document.get("media")
    if not isinstance(media, dict) or not media:
        raise InputError("names no media", path=path)
    return {name: _parameters(values, f"media.{name}", path) for name, values in media.items()}


def _document(one: Scattering) -> dict[str, Any]:
    return ({"kind": KIND_OF[type(one)]} if type(one) in KIND_OF else {}) | asdict(one)


def _simple(values: dict[str, Any], place: str, path: Path) -> SimplePhase:
    try:
        return SIMPLE[values["kind"]](**values).to_phase()
    except (KeyError, ValidationError) as error:
        raise InputError(f"is no scattering of kind {values['kind']!r}", path=path, place=place) from error


def _parameters(values: Any, place: str, path: Path) -> Scattering:
    if isinstance(values, dict) and isinstance(values.get("kind"), str):
        return _simple(values, place, path)
    if not isinstance(values, dict) or not NEEDED <= set(values) <= set(TYPES):
        raise InputError(f"needs {', '.join(sorted(NEEDED))}", path=path, place=place)
    try:
        return FiberScatteringParameters(**{name: _value(name, value) for name, value in values.items()})
    except InputError as error:
        raise InputError(error.what, path=path, place=place, hint=error.hint) from error


def _value(name: str, value: Any) -> Any:
    """A word, a finite number or three, rows of them, or null, as the field says; else `InputError`."""
    if TYPES[name] == "str" and isinstance(value, str):
        return value
    if "None" in TYPES[name] and value is None:
        return None
    if TYPES[name].startswith("tuple"):
        if isinstance(value, list) and len(value) == 3 and all(map(_is_number, value)):
            return tuple(value)
        raise InputError(f"{name} is {value!r}; need three finite numbers")
    if TYPES[name].startswith("float") and _is_number(value):
        return value
    if TYPES[name].startswith("Table"):
        return _table(name, value)
    raise InputError(f"{name} is {value!r}; need {TYPES[name]}")


def _table(name: str, value: Any) -> Table:
    """Its numbers of rows and knots are checked by the parameters themselves."""
    rows = value if isinstance(value, list) else [value]
    if not all(isinstance(row, list) and all(map(_is_number, row)) for row in rows):
        raise InputError(f"{name} needs rows of finite numbers")
    return tuple(tuple(map(float, row)) for row in rows)


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


TYPES = {field.name: str(field.type) for field in fields(FiberScatteringParameters)}
NEEDED = {
    field.name
    for field in fields(FiberScatteringParameters)
    if field.default is MISSING and field.default_factory is MISSING
}
