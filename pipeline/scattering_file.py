"""scattering.json: the scattering parameters of a job's media, as numbers that read back exactly."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import MISSING, asdict, fields
from pathlib import Path
from typing import Any

from weft.fiber_model.scattering_parameters import FiberScatteringParameters
from weft.files.atomic import atomic_write
from weft.files.errors import InputError

FORMAT = "weft scattering parameters"
FORMAT_VERSION = 1
MAX_BYTES = 2**24
EVERY_MEDIUM = "*"
"""The entry for the media that have none of their own."""


def write_scattering(path: Path, media: Mapping[str, FiberScatteringParameters]) -> None:
    document = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "units": {"angles": "rad", "colors": "linear RGB"},
        "media": {name: asdict(parameters) for name, parameters in media.items()},
    }
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(document, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def read_scattering(path: Path) -> dict[str, FiberScatteringParameters]:
    """Raises `InputError` where the file is not one of ours."""
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError("is too large for scattering parameters", path=path)
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", path=path) from error
    except (ValueError, RecursionError) as error:
        raise InputError("is not valid JSON", path=path) from error
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise InputError("holds no scattering parameters of weft", path=path)
    if document.get("format_version") != FORMAT_VERSION:
        found = document.get("format_version")
        raise InputError(f"has format version {found}; this weft reads {FORMAT_VERSION}", path=path)
    media = document.get("media")
    if not isinstance(media, dict) or not media:
        raise InputError("names no media", path=path)
    return {name: _parameters(values, f"media.{name}", path) for name, values in media.items()}


def _parameters(values: Any, place: str, path: Path) -> FiberScatteringParameters:
    names = {field.name for field in fields(FiberScatteringParameters)}
    needed = {
        field.name
        for field in fields(FiberScatteringParameters)
        if field.default is MISSING and field.default_factory is MISSING
    }
    if not isinstance(values, dict) or not needed <= set(values) <= names:
        raise InputError(f"needs {', '.join(sorted(needed))}", path=path, place=place)
    try:
        return FiberScatteringParameters(**{name: _value(value) for name, value in values.items()})
    except (TypeError, ValueError) as error:
        raise InputError(str(error), path=path, place=place) from error


def _value(value: Any) -> Any:
    """JSON arrays become colors; only finite numbers, words and null are allowed."""
    if isinstance(value, list):
        return tuple(_value(item) for item in value)
    if isinstance(value, str) or value is None:
        return value
    if isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value):
        return value
    raise ValueError(f"found {value!r}, which is no finite number")
