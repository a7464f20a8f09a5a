"""JSON files of scattering parameters with where they come from and how well they are known.

Values stand under the keys of the [scattering] table, angles in degrees: `[scattering] fit = "x.json"` lies
under a job's own keys as a preset does. The README of this folder describes the format.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from weft.files.atomic import atomic_write
from weft.files.errors import InputError
from weft.files.json_file import read_json

from .config import LobesConfig
from .parameters import FiberScatteringParameters

FORMAT = "weft fiber scattering"
FORMAT_VERSION = 1
MAX_BYTES = 2**24
COLORS = ("fresnel_r", "color_r", "color_tt", "color_trt")
CHANNELS = "rgb"
NEEDED_PROVENANCE = ("source", "method")


@dataclass(frozen=True)
class ParameterCovariance:
    """Covariance of single numbers; `names` as `scalar_names()` gives them, angles in degrees."""

    names: tuple[str, ...]
    matrix: NDArray[np.float64]
    """[name_count, name_count], symmetric, in the units of the two names."""


@dataclass(frozen=True)
class ScatteringParameterFile:
    """What one file holds. `provenance` says at least `source` and `method`; the rest is the writer's."""

    lobes: LobesConfig
    """The values in degrees, as the [scattering] table has them."""
    provenance: Mapping[str, Any]
    standard_errors: Mapping[str, float] = field(default_factory=dict)
    """One standard deviation of single numbers, by the names of `scalar_names()`, angles in degrees."""
    covariance: ParameterCovariance | None = None

    @property
    def parameters(self) -> FiberScatteringParameters:
        return self.lobes.to_parameters()


def scalar_names() -> tuple[str, ...]:
    """Every single number of a parameter set: "longitudinal_width_r_deg", …, "color_tt.r", "color_tt.g", …"""
    names: list[str] = []
    for name in LobesConfig.model_fields:
        if name in COLORS:
            names += [f"{name}.{channel}" for channel in CHANNELS]
        elif name.endswith("_deg") or name.startswith(("fresnel_tt", "tail_")):
            names.append(name)
    return tuple(names)


def save_parameters(path: Path, content: ScatteringParameterFile) -> None:
    """Raises `InputError`, before writing, for what `load_parameters` would refuse."""
    document: dict[str, Any] = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "units": {"angles": "degrees", "colors": "linear RGB in [0, 1]"},
        "scattering": content.lobes.model_dump(
            mode="json", exclude_none=True, exclude={"preset", "fit", "by_type"}
        ),
        "provenance": dict(content.provenance),
    }
    if content.standard_errors:
        document["standard_errors"] = dict(content.standard_errors)
    if content.covariance is not None:
        matrix = np.asarray(content.covariance.matrix, dtype=np.float64).tolist()
        document["covariance"] = {"names": list(content.covariance.names), "matrix": matrix}
    _content(document, path)
    text = json.dumps(document, indent=2, allow_nan=False) + "\n"
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def load_parameters(path: Path) -> ScatteringParameterFile:
    """Raises `InputError` where the file is not one of ours or its values cannot be."""
    return _content(read_document(path), path)


def read_document(path: Path) -> dict[str, Any]:
    """The file's JSON object after a look at its kind and version; the values are not checked yet."""
    document = read_json(path, max_bytes=MAX_BYTES, what="scattering parameters")
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise InputError(
            "holds no fitted scattering parameters",
            path=path,
            hint=f'Such a file says "format": "{FORMAT}".',
        )
    version = document.get("format_version")
    if version != FORMAT_VERSION:
        raise InputError(f"has format version {version}; this weft reads {FORMAT_VERSION}", path=path)
    return document


def _content(document: Mapping[str, Any], path: Path) -> ScatteringParameterFile:
    return ScatteringParameterFile(
        lobes=_lobes(document.get("scattering"), path),
        provenance=_provenance(document.get("provenance"), path),
        standard_errors=_standard_errors(document.get("standard_errors", {}), path),
        covariance=_covariance(document.get("covariance"), path),
    )


def _lobes(table: Any, path: Path) -> LobesConfig:
    if not isinstance(table, dict) or not set(table).isdisjoint(("preset", "fit", "by_type")):
        raise InputError(
            "must be an object with the keys of one fiber's lobes", path=path, place="scattering"
        )
    try:
        return LobesConfig(**table)
    except ValidationError as error:
        details = error.errors(include_url=False)[0]
        place = ".".join(str(part) for part in ("scattering", *details["loc"]))
        raise InputError(
            f"{details['msg'][0].lower()}{details['msg'][1:]}", path=path, place=place
        ) from error


def _provenance(value: Any, path: Path) -> dict[str, Any]:
    said = value if isinstance(value, dict) else {}
    for name in NEEDED_PROVENANCE:
        if not (isinstance(said.get(name), str) and said[name].strip()):
            raise InputError(
                "must say in words where the values come from", path=path, place=f"provenance.{name}"
            )
    try:
        json.dumps(said, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise InputError("holds what JSON cannot", path=path, place="provenance") from error
    return said


def _standard_errors(value: Any, path: Path) -> dict[str, float]:
    place = "standard_errors"
    if not isinstance(value, dict):
        raise InputError("must be an object of numbers", path=path, place=place)
    _refuse_unknown_names(value, path, place)
    for name, number in value.items():
        if not (_is_number(number) and number >= 0):
            raise InputError(f"is {number!r}; need a number >= 0", path=path, place=f"{place}.{name}")
    return {name: float(number) for name, number in value.items()}


def _covariance(value: Any, path: Path) -> ParameterCovariance | None:
    if value is None:
        return None
    names = value.get("names") if isinstance(value, dict) else None
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise InputError("must have 'names', a list, and 'matrix'", path=path, place="covariance")
    _refuse_unknown_names(names, path, "covariance.names")
    if len(set(names)) != len(names):
        raise InputError("names a number twice", path=path, place="covariance.names")
    try:
        matrix = np.array(value.get("matrix"), dtype=np.float64).reshape(len(names), len(names))
    except (TypeError, ValueError) as error:
        what = f"must be {len(names)} rows of {len(names)} numbers"
        raise InputError(what, path=path, place="covariance.matrix") from error
    if not np.all(np.isfinite(matrix)) or np.any(np.diag(matrix) < 0):
        raise InputError("must be finite with no negative variance", path=path, place="covariance.matrix")
    scale = np.sqrt(np.outer(np.diag(matrix), np.diag(matrix)))
    if np.any(np.abs(matrix - matrix.T) > 1e-9 * scale):
        raise InputError("must be symmetric", path=path, place="covariance.matrix")
    return ParameterCovariance(tuple(names), matrix)


def _refuse_unknown_names(names: Any, path: Path, place: str) -> None:
    known = scalar_names()
    for name in names:
        if name not in known:
            raise InputError(
                f"'{name}' is no parameter", path=path, place=place, hint=f"Known: {', '.join(known)}."
            )


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
