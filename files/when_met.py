"""Settings whose validators are built when a job first has them.

pydantic builds the validator of a model with those of all models in it, though a job has one camera of two
and one light of twelve. In unions marked `ByKind`, and for tables marked `WhenMet`, a model is built when a
value for it is met. Errors, their places and the JSON Schema (but for titles) are those of the plain
annotation. The models must have `defer_build=True`; one that stands unmarked in another is built with it.
"""

from __future__ import annotations

from typing import Annotated, Any, get_args

from pydantic import BaseModel, Field, GetCoreSchemaHandler, GetJsonSchemaHandler, TypeAdapter
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

STANDS_FOR = "weft_stands_for"


class _Marker:
    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """That of the plain annotation."""
        plain = TypeAdapter(schema["metadata"][STANDS_FOR]).core_schema
        # pydantic names a model in $defs only where it stands inside of something
        return handler(core_schema.definitions_schema(plain, []))


class ByKind(_Marker):
    """In `Annotated[A | B, ByKind()]`, in place of `Field(discriminator="kind")`."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        choices = {
            kind: _built_when_met(member)
            for member in get_args(source)
            for kind in get_args(member.model_fields["kind"].annotation)
        }
        plain = Annotated[source, Field(discriminator="kind")]
        return core_schema.tagged_union_schema(choices, discriminator="kind", metadata={STANDS_FOR: plain})


class WhenMet(_Marker):
    """In `Annotated[A, WhenMet()]`, for one model."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return _built_when_met(source)


def _built_when_met(model: type[BaseModel]) -> CoreSchema:
    def validate(value: Any, info: core_schema.ValidationInfo) -> BaseModel:
        return model.model_validate(value, context=info.context)

    return core_schema.with_info_plain_validator_function(validate, metadata={STANDS_FOR: model})
