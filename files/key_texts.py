"""What the keys of settings mean: the texts below them in the source, read only where they are shown.

pydantic's use_attribute_docstrings reads the source of every class whenever it is imported, a tenth of the
start of `weft render`; a schema and a message about a mistake need the texts, a picture does not.
"""

from __future__ import annotations

import ast
import functools
import inspect
import textwrap
from itertools import pairwise
from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue


def key_text(model: type[BaseModel], name: str) -> str:
    """Of a field, from the class that declares it; empty where there is none."""
    field = model.model_fields.get(name)
    if field is None or field.description is not None:
        return (field.description or "") if field else ""
    texts_of = getattr(model, "keys_as_in", model)
    home = next((cls for cls in texts_of.__mro__ if name in inspect.get_annotations(cls)), None)
    return _texts(home).get(name, "") if home else ""


class DescribedSchema(GenerateJsonSchema):
    """JSON Schema with these texts as descriptions."""

    def model_schema(self, schema: Any) -> JsonSchemaValue:
        json_schema = super().model_schema(schema)
        for name, value in json_schema.get("properties", {}).items():
            if text := key_text(schema["cls"], name):
                value["description"] = text
        return json_schema


@functools.cache
def _texts(cls: type) -> dict[str, str]:
    try:
        source = textwrap.dedent(inspect.getsource(cls))
    except (OSError, TypeError):  # an installation without sources
        return {}
    definition = ast.parse(source).body[0]
    assert isinstance(definition, ast.ClassDef)
    return {
        key.target.id: inspect.cleandoc(text.value.value)
        for key, text in pairwise(definition.body)
        if isinstance(key, ast.AnnAssign)
        and isinstance(key.target, ast.Name)
        and isinstance(text, ast.Expr)
        and isinstance(text.value, ast.Constant)
        and isinstance(text.value.value, str)
    }
