"""Laying one table over another, each value keeping the place where it was written."""

from __future__ import annotations

from typing import Any

from .toml_source import KeyPath, Origin, TomlDocument

NOTHING = TomlDocument({}, {})


def merge(lower: TomlDocument, upper: TomlDocument) -> TomlDocument:
    """`upper` wins key by key. Arrays are replaced whole, and so is a table whose `kind` changes."""
    table = merge_values(lower.table, upper.table)
    origins: dict[KeyPath, Origin] = {}
    for path in _paths(table):
        origin = upper.origins.get(path)
        if origin is None and _is_as_before(path, lower.table, table):
            origin = lower.origins.get(path)
        if origin is not None:
            origins[path] = origin
    return TomlDocument(table, origins)


def _is_as_before(path: KeyPath, lower: Any, merged: Any) -> bool:
    """Whether what stands at `path` was not replaced: it has its old value, or is a table merged by keys."""
    before, now = _at(path, lower), _at(path, merged)
    return before == now or (isinstance(now, dict) and all(isinstance(part, str) for part in path))


def _at(path: KeyPath, value: Any) -> Any:
    for part in path:
        try:
            value = value[part]
        except (LookupError, TypeError):
            return None
    return value


def merge_values(lower: Any, upper: Any) -> Any:
    """As `merge`, for values alone."""
    if not (isinstance(lower, dict) and isinstance(upper, dict)):
        return upper
    if "kind" in upper and upper["kind"] != lower.get("kind", upper["kind"]):
        return upper
    merged = dict(lower)
    for key, value in upper.items():
        merged[key] = merge_values(lower[key], value) if key in lower else value
    return merged


def _paths(value: Any, path: KeyPath = ()) -> list[KeyPath]:
    """The places of all values below `value`, tables and arrays included."""
    paths = [path] if path else []
    if isinstance(value, dict):
        paths += [below for key, item in value.items() for below in _paths(item, (*path, key))]
    elif isinstance(value, list):
        paths += [below for index, item in enumerate(value) for below in _paths(item, (*path, index))]
    return paths


def placed_at(document: TomlDocument, path: tuple[str, ...]) -> TomlDocument:
    """The same values as a sub-table: `path = ("fibers",)` gives `[fibers]`."""
    table: dict[str, Any] = document.table
    for key in reversed(path):
        table = {key: table}
    return TomlDocument(table, {(*path, *key): origin for key, origin in document.origins.items()})


def sub_table(document: TomlDocument, path: tuple[str, ...]) -> TomlDocument | None:
    """The table at `path` as a document of its own, or None where there is none."""
    value: Any = document.table
    for key in path:
        value = value.get(key) if isinstance(value, dict) else None
    if not isinstance(value, dict):
        return None
    depth = len(path)
    origins = {key[depth:]: origin for key, origin in document.origins.items() if key[:depth] == path}
    return TomlDocument(value, {key: origin for key, origin in origins.items() if key})


def without(document: TomlDocument, key: str) -> TomlDocument:
    """The document without one top-level key."""
    table = {name: value for name, value in document.table.items() if name != key}
    return TomlDocument(table, {path: o for path, o in document.origins.items() if path[0] != key})
