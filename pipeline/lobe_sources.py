"""What `weft scattering` is asked about: presets by name, fitted parameters, jobs and tables of lobes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pydantic import BaseModel, ConfigDict

from weft.fiber_model.scattering.config import ScatteringConfig
from weft.fiber_model.scattering.parameter_file import FORMAT as FIT_FORMAT
from weft.fiber_model.scattering.parameter_file import load_parameters
from weft.fiber_model.scattering.parameters import FiberScatteringParameters
from weft.files.errors import InputError
from weft.files.json_file import read_json

from .job import load_job
from .messages import did_you_mean
from .presets import CONFIGS, preset_names
from .scattering_file import EVERY_MEDIUM, MAX_BYTES, read_scattering
from .toml_source import read_toml

MOST = 6
"""Sets in one picture."""

Lobes = dict[str, FiberScatteringParameters]
"""Parameter sets by the name to show."""


class _JobOfLobes(BaseModel):
    """The one table of a job that matters here; the others may be wrong or missing."""

    model_config = ConfigDict(extra="ignore")

    scattering: ScatteringConfig


def lobes_of_all(names: Sequence[str]) -> Lobes:
    """Raises `InputError` for what is none of these, and for more than `MOST` sets."""
    found: Lobes = {}
    for name in names:
        for label, parameters in lobes_of(name).items():
            found[_free_label(label, found)] = parameters
    if not 0 < len(found) <= MOST:
        raise InputError(f"these are {len(found)} parameter sets; one picture shows 1 to {MOST}")
    return found


def lobes_of(name: str) -> Lobes:
    """One set; or a set for each medium, where a file has several."""
    path = Path(name)
    if path.suffix == ".json":
        return _lobes_of_json(path)
    if path.suffix == ".toml":
        return _lobes_of_toml(path, path.stem)
    known = preset_names("scattering")
    if name not in known:
        hint = "" if did_you_mean(name, known, list_known=0) else " Or name a .toml or .json file."
        raise InputError(
            f"there is no scattering preset '{name}'{did_you_mean(name, known, list_known=40)}.{hint}"
        )
    return _lobes_of_toml(CONFIGS / "presets" / "scattering" / f"{name}.toml", name)


def _lobes_of_json(path: Path) -> Lobes:
    document = read_json(path, max_bytes=MAX_BYTES, what="scattering parameters")
    if isinstance(document, dict) and document.get("format") == FIT_FORMAT:
        return {path.stem: load_parameters(path).parameters}
    media = {
        name: one for name, one in read_scattering(path).items() if isinstance(one, FiberScatteringParameters)
    }
    if not media:
        raise InputError("holds no fibers' lobes, but simple phase functions", path=path)
    return {path.stem if name == EVERY_MEDIUM else name: parameters for name, parameters in media.items()}


def _lobes_of_toml(path: Path, label: str) -> Lobes:
    is_job = isinstance(read_toml(path).table.get("scattering"), dict) or "include" in read_toml(path).table
    config = load_job(path, model=_JobOfLobes if is_job else ScatteringConfig).config
    scattering = config.scattering if is_job else config
    types = {f"{label}: {name}": lobes.to_parameters() for name, lobes in scattering.by_type.items()}
    return {label: scattering.to_parameters(), **types}


def _free_label(label: str, taken: Lobes) -> str:
    if label not in taken:
        return label
    return next(f"{label} ({n})" for n in range(2, len(taken) + 3) if f"{label} ({n})" not in taken)
