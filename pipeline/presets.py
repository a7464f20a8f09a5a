"""`preset = "cotton2"`: the values of configs/presets/<family>/cotton2.toml lie under the table's own."""

from __future__ import annotations

from pathlib import Path

from .merging import merge, merge_values, placed_at, sub_table, without
from .messages import Problem, did_you_mean
from .toml_source import KeyPath, TomlDocument, read_toml

CONFIGS = Path(__file__).resolve().parent.parent / "configs"
"""`weft/configs` of an installed package, `configs/` of a checkout: in both it lies beside this folder."""

FAMILIES = ("fibers", "scattering")
"""The tables of a job that take presets, named as the folders under configs/presets/."""

BY_TYPE = ("scattering", "by_type")
"""Tables of single yarn types: each is [scattering] with some keys changed, or another preset."""


def preset_names(family: str) -> list[str]:
    return sorted(file.stem for file in (CONFIGS / "presets" / family).glob("*.toml"))


def apply_presets(document: TomlDocument, problems: list[Problem]) -> TomlDocument:
    """Each table that names a preset, completed by it. Unknown names are added to `problems`."""
    document = _complete_types(document)
    for family in FAMILIES:
        for path in _tables_naming_a_preset(document, (family,)):
            document = _complete(document, family, path, problems)
    return document


def _complete_types(document: TomlDocument) -> TomlDocument:
    """Lay each [scattering.by_type.<yarn type>] over [scattering], unless it names a preset of its own.

    [fibers.by_type.…] is left as it is: the fiber stage lays it over [fibers] itself.
    """
    types = sub_table(document, BY_TYPE)
    base = sub_table(document, BY_TYPE[:1])
    if types is None or base is None:
        return document
    shared = without(base, "by_type")
    for name, table in types.table.items():
        if isinstance(table, dict) and "preset" not in table:
            path = (*BY_TYPE, name)
            document = merge(document, placed_at(merge(shared, _part(document, path)), path))
    return document


def _part(document: TomlDocument, path: tuple[str, ...]) -> TomlDocument:
    part = sub_table(document, path)
    assert part is not None
    return part


def _tables_naming_a_preset(document: TomlDocument, path: tuple[str, ...]) -> list[tuple[str, ...]]:
    part = sub_table(document, path)
    if part is None:
        return []
    below = [found for key in part.table for found in _tables_naming_a_preset(document, (*path, key))]
    return [path, *below] if isinstance(part.table.get("preset"), str) else below


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
    completed = placed_at(merge(preset, part), path)
    return TomlDocument(
        merge_values(document.table, completed.table), {**document.origins, **completed.origins}
    )
