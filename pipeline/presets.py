"""Values that lie under a table's own: `preset = "cotton2"`, the file configs/presets/<family>/cotton2.toml,
or, in [scattering], `fit = "cotton_fit.json"`, a file of fitted parameters.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from weft.files.errors import InputError
from weft.files.input_file import InputFile

from .merging import merge, merge_values, placed_at, sub_table, without
from .messages import Problem, did_you_mean, problem_from
from .toml_source import KeyPath, Origin, TomlDocument, read_toml

CONFIGS = Path(__file__).resolve().parent.parent / "configs"
"""`weft/configs` of an installed package, `configs/` of a checkout: in both it lies beside this folder."""

FAMILIES = ("fibers", "scattering")
"""The tables of a job that take presets, named as the folders under configs/presets/."""

STAND_IN = "reference"
"""The scattering preset that stands in for a fit that is not made yet, to check the rest of a job."""
BY_TYPE = ("scattering", "by_type")
"""Tables of single yarn types: each is [scattering] with some keys changed, or another preset."""


def preset_names(family: str) -> list[str]:
    return sorted(file.stem for file in (CONFIGS / "presets" / family).glob("*.toml"))


def apply_presets(
    document: TomlDocument, problems: list[Problem], *, pending_fit: Path | None = None
) -> TomlDocument:
    """Each table that names a preset or a fit, completed by it. What is wrong is added to `problems`.

    The values of `pending_fit`, a file that a fit has yet to make, are stood in for by a preset's.
    """
    document = _complete_types(document)
    if pending_fit is not None:
        for path in _tables_naming("fit", document, BY_TYPE[:1]):
            document = _standing_in(document, path, pending_fit)
    for family in FAMILIES:
        for path in _tables_naming("preset", document, (family,)):
            document = _complete(document, family, path, problems)
    for path in _tables_naming("fit", document, BY_TYPE[:1]):
        document = _complete_by_fit(document, path, problems)
    return document


def _complete_types(document: TomlDocument) -> TomlDocument:
    """Lay each [scattering.by_type.<yarn type>] over [scattering], unless it has a preset, fit or kind.

    [fibers.by_type.…] is left as it is: the fiber stage lays it over [fibers] itself.
    """
    types = sub_table(document, BY_TYPE)
    base = sub_table(document, BY_TYPE[:1])
    if types is None or base is None:
        return document
    shared = without(base, "by_type")
    for name, table in types.table.items():
        if isinstance(table, dict) and not {"preset", "fit", "kind"} & set(table):
            path = (*BY_TYPE, name)
            document = merge(document, placed_at(merge(shared, _part(document, path)), path))
    return document


def _part(document: TomlDocument, path: tuple[str, ...]) -> TomlDocument:
    part = sub_table(document, path)
    assert part is not None
    return part


def _tables_naming(source: str, document: TomlDocument, path: tuple[str, ...]) -> list[tuple[str, ...]]:
    part = sub_table(document, path)
    if part is None:
        return []
    below = [found for key in part.table for found in _tables_naming(source, document, (*path, key))]
    return [path, *below] if isinstance(part.table.get(source), str) else below


def _complete(
    document: TomlDocument, family: str, path: tuple[str, ...], problems: list[Problem]
) -> TomlDocument:
    part = _part(document, path)
    name = str(part.table["preset"])
    names = preset_names(family)
    if name not in names:
        key: KeyPath = (*path, "preset")
        what = f"there is no {family} preset '{name}'{did_you_mean(name, names, list_known=40)}"
        problems.append(Problem(document.origin(key), key, what))
        return document
    preset = read_toml(CONFIGS / "presets" / family / f"{name}.toml")
    return _laid_under(document, preset, path)


def _standing_in(document: TomlDocument, path: tuple[str, ...], pending: Path) -> TomlDocument:
    """The document with a preset in place of the fit that the table at `path` names, if it is this one."""
    part = _part(document, path)
    named = part.table["fit"]
    if os.path.realpath(Path(named.folder, named)) != os.path.realpath(pending):
        return document
    preset = read_toml(CONFIGS / "presets" / "scattering" / f"{STAND_IN}.toml")
    completed = merge(preset, without(part, "fit"))
    origins = {key: origin for key, origin in document.origins.items() if key != (*path, "fit")}
    return TomlDocument(
        _replaced(document.table, path, completed.table), {**origins, **placed_at(completed, path).origins}
    )


def _replaced(table: dict[str, Any], path: tuple[str, ...], value: Any) -> dict[str, Any]:
    """The table with another value at `path`."""
    first, *rest = path
    return {**table, first: _replaced(table[first], tuple(rest), value) if rest else value}


def _complete_by_fit(document: TomlDocument, path: tuple[str, ...], problems: list[Problem]) -> TomlDocument:
    from weft.fiber_model.scattering.parameter_file import load_parameters, read_document

    part, key = _part(document, path), (*path, "fit")
    origin = document.origin(key)
    if "preset" in part.table:
        problems.append(
            Problem(origin, key, "a table takes its values from a preset or from a fit, not both")
        )
        return document
    try:
        file = TypeAdapter(InputFile).validate_python(part.table["fit"])
        load_parameters(file)  # names what is wrong in the file itself
        values = read_document(file)["scattering"]
    except ValidationError as error:
        problems.append(Problem(origin, key, error.errors()[0]["msg"]))
    except InputError as error:
        problems.append(problem_from(error, origin, key))
    else:
        origins: dict[KeyPath, Origin] = {(name,): Origin(file) for name in values}
        return _laid_under(document, TomlDocument(values, origins), path)
    return document


def _laid_under(document: TomlDocument, lower: TomlDocument, path: tuple[str, ...]) -> TomlDocument:
    """The document with the values of `lower` under those of its table at `path`."""
    completed = placed_at(merge(lower, _part(document, path)), path)
    return TomlDocument(
        merge_values(document.table, completed.table), {**document.origins, **completed.origins}
    )
