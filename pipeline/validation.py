"""pydantic's errors as lines for people: the key as written, what was found, what would be right."""

from __future__ import annotations

import types
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from .messages import Problem, did_you_mean
from .toml_source import KeyPath, Origin, TomlDocument, dotted

SHOWN_VALUE_LENGTH = 60

PLAIN_DEMANDS = {
    **dict.fromkeys(("float_type", "float_parsing"), "must be a number"),
    **dict.fromkeys(("int_type", "int_parsing", "int_from_float"), "must be a whole number"),
    **dict.fromkeys(("bool_type", "bool_parsing"), "must be true or false"),
    **dict.fromkeys(("tuple_type", "list_type"), "must be a list, as in [1, 2]"),
    **dict.fromkeys(("dict_type", "model_type", "model_attributes_type"), "must be a table"),
    **dict.fromkeys(("string_type", "path_type"), "must be text"),
    "finite_number": "must be finite",
    "too_long": "must have at most {max_length} items",
    "too_short": "must have at least {min_length} items",
}
"""pydantic's own words for these say how it parses rather than what to write."""


def problems_of(
    error: ValidationError, model: type[BaseModel], document: TomlDocument, path: Path
) -> list[Problem]:
    """One problem for each key, in the order of the file."""
    whats: dict[KeyPath, list[str]] = {}
    every = list(_all_details(error))
    for details in every:
        if details["type"] == "too_short" and _has_wrong_items(details["loc"], every):
            continue
        key, table = _key_of(details["loc"], model)
        key, what = _explain(details, key, table, model)
        if what not in whats.setdefault(key, []):
            whats[key].append(what)
    problems = [
        Problem(document.origin(key) or Origin(path), key, _joined(texts)) for key, texts in whats.items()
    ]
    return sorted(problems, key=lambda problem: _position(problem.origin))


def _all_details(error: ValidationError, location: tuple[str | int, ...] = ()) -> Iterator[ErrorDetails]:
    """Also those of a validation that a validator ran itself."""
    for details in error.errors(include_url=False):
        details["loc"] = (*location, *details["loc"])
        inner = details.get("ctx", {}).get("error")
        if isinstance(inner, ValidationError):
            yield from _all_details(inner, details["loc"])
        else:
            yield details


def _has_wrong_items(location: tuple[str | int, ...], every: Sequence[ErrorDetails]) -> bool:
    """pydantic does not count the items that it refuses, and calls what is left too short."""
    return any(details["loc"][: len(location)] == location != details["loc"] for details in every)


def _position(origin: Origin | None) -> tuple[str, int]:
    return ("", 0) if origin is None else (str(origin.path), origin.line)


def _joined(texts: list[str]) -> str:
    """Branches of a union complain one by one of the same value: `found 'x'; must be a number, or 'auto'`."""
    found, _, first = texts[0].partition("; must ")
    others = [text.removeprefix(f"{found}; must be ") for text in texts[1:]]
    return ", or ".join([texts[0], *others]) if first else texts[0]


def _explain(
    details: ErrorDetails, key: KeyPath, table: type[BaseModel] | None, model: type[BaseModel]
) -> tuple[KeyPath, str]:
    kind, value, context = details["type"], details["input"], details.get("ctx", {})
    if kind == "extra_forbidden":
        return key, _unknown_key(key, value, table, model)
    if kind == "missing":
        return key, f"is missing{_what_it_is(table, key)}"
    if kind == "union_tag_invalid":
        known = _quoted_names(context["expected_tags"])
        return (*key, "kind"), f"found '{context['tag']}'; {_one_of(known)}{_close(context['tag'], known)}"
    if kind == "union_tag_not_found":
        return (*key, "kind"), "is missing; it says which kind this is"
    if kind in ("literal_error", "enum"):
        known = _quoted_names(context["expected"])
        return key, f"found {_shown(value)}; {_one_of(known)}{_close(value, known)}"
    if kind in ("input_file", "value_error"):
        return key, details["msg"].removeprefix("Value error, ")
    return key, f"found {_shown(value)}; {_demand(kind, details['msg'], context)}"


def _unknown_key(key: KeyPath, value: Any, table: type[BaseModel] | None, model: type[BaseModel]) -> str:
    name = str(key[-1])
    what = f"unknown {'table' if isinstance(value, dict) else 'key'}"
    for path, home in _tables(model):
        if name in home.model_fields and path == _without_indices(key[:-1]):
            return f"{what}; it goes with kind = '{', '.join(map(str, _kinds(home)))}'"
    for path, home in _tables(model):
        if name in home.model_fields and path and name != "kind":
            return f"{what}; it belongs in [{dotted(path)}]"
    return what + did_you_mean(name, table.model_fields if table else [])


def _without_indices(key: KeyPath) -> KeyPath:
    return tuple(part for part in key if isinstance(part, str))


def _what_it_is(table: type[BaseModel] | None, key: KeyPath) -> str:
    text = _text_of(table, str(key[-1])) if table else ""
    return f" ({text[:1].lower()}{text[1:].split('. ')[0].rstrip('.')})" if text else ""


def _text_of(table: type[BaseModel], name: str) -> str:
    from weft.files.key_texts import key_text

    return key_text(table, name)


def _quoted_names(text: str) -> list[str]:
    return [name.strip().strip("'") for name in text.replace(" or ", ", ").split(", ")]


def _one_of(known: Sequence[str]) -> str:
    return "must be " + " or ".join(f"'{name}'" for name in known)


def _close(value: Any, known: Sequence[str]) -> str:
    return did_you_mean(str(value), known, list_known=0)


def _shown(value: Any) -> str:
    if isinstance(value, dict):
        return "a table"
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    return text if len(text) <= SHOWN_VALUE_LENGTH else f"{text[:SHOWN_VALUE_LENGTH]}…"


def _demand(kind: str, message: str, context: dict[str, Any]) -> str:
    if kind in PLAIN_DEMANDS:
        return PLAIN_DEMANDS[kind].format(**context)
    for start in ("Input should be ", "Input must be "):
        if message.startswith(start):
            return "must be " + message.removeprefix(start)
    return message[0].lower() + message[1:]


# Where an error stands: pydantic's location carries the tags of unions, which the file does not have.


@dataclass
class _Walk:
    """A walk along pydantic's location through the models, collecting the keys that are in the file."""

    annotation: Any
    table: type[BaseModel] | None = None
    key: KeyPath = ()

    def step(self, part: str | int) -> None:
        members = _union_members(self.annotation)
        if len(members) > 1:
            # not a key of the file: pydantic names the branch of a union it speaks of
            self.annotation = _chosen_member(members, part)
            return
        self.annotation = members[0]
        self.key = (*self.key, part)
        self._enter(part)

    def _enter(self, part: str | int) -> None:
        annotation, self.table = self.annotation, None
        if _is_model(annotation):
            self.table = annotation
            field = annotation.model_fields.get(str(part))
            self.annotation = field.annotation if field else Any
        elif get_origin(annotation) in (list, tuple, dict):
            arguments = [item for item in get_args(annotation) if item is not Ellipsis]
            index = part if isinstance(part, int) and get_origin(annotation) is tuple else -1
            self.annotation = arguments[min(index, len(arguments) - 1)] if arguments else Any
        else:
            self.annotation = Any


def _key_of(
    location: tuple[str | int, ...], model: type[BaseModel]
) -> tuple[KeyPath, type[BaseModel] | None]:
    """The key in the file, and the model of the table it stands in (None where that is no model)."""
    walk = _Walk(model)
    for part in location:
        walk.step(part)
    return walk.key, walk.table


def _union_members(annotation: Any) -> list[Any]:
    """The types a value may have, without None."""
    while get_origin(annotation) is Annotated or hasattr(annotation, "__value__"):
        annotation = get_args(annotation)[0] if get_args(annotation) else annotation.__value__
    if get_origin(annotation) not in (Union, types.UnionType):
        return [annotation]
    members = [member for member in get_args(annotation) if member is not type(None)]
    return [below for member in members for below in _union_members(member)]


def _chosen_member(members: list[Any], label: str | int) -> Any:
    """The member of a union that pydantic's label (a tag or a type's name) speaks of."""
    for member in members:
        if _is_model(member) and (label == member.__name__ or label in _kinds(member)):
            return member
    for member in members:
        if str(label).startswith(getattr(get_origin(member) or member, "__name__", "?")):
            return member
    return Any


def _kinds(model: type[BaseModel]) -> tuple[Any, ...]:
    field = model.model_fields.get("kind")
    return get_args(field.annotation) if field and get_origin(field.annotation) is Literal else ()


def _is_model(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


def _tables(model: type[BaseModel], path: KeyPath = ()) -> Iterator[tuple[KeyPath, type[BaseModel]]]:
    """Every table that a job may have, by its path without array indices, with its model."""
    yield path, model
    for name, field in model.model_fields.items():
        for member in _union_members(field.annotation):
            for item in (inner for outer in (member, *get_args(member)) for inner in _union_members(outer)):
                if _is_model(item) and len(path) < 6:
                    yield from _tables(item, (*path, name))
