"""Models that are built when a job has them answer as those that are built at once."""

from __future__ import annotations

from typing import Annotated, Literal

import pytest
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from weft.files.when_met import ByKind, WhenMet


class _Model(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)


def models(union_marker, model_marker):
    """A model with a union and a table in it, and the models of these, none of them built."""

    class Ball(_Model):
        kind: Literal["ball", "sphere"] = "ball"
        radius: float = Field(default=1.0, gt=0)

    class Box(_Model):
        kind: Literal["box"] = "box"
        size: tuple[float, float]

    class Table(_Model):
        legs: int = 4

    class Scene(_Model):
        shapes: tuple[Annotated[Ball | Box, *union_marker], ...] = ()
        table: Annotated[Table, *model_marker] | None = None

    return Scene, (Ball, Box, Table)


@pytest.fixture
def later():
    return models([ByKind()], [WhenMet()])


@pytest.fixture
def at_once():
    return models([Field(discriminator="kind")], [Field()])


def test_only_what_is_met_is_built(later):
    scene, (ball, box, table) = later
    scene.model_validate({"shapes": [{"kind": "ball"}]})
    assert [model.__pydantic_complete__ for model in (ball, box, table)] == [True, False, False]


VALUES = [
    {"shapes": [{"kind": "ball", "radius": "2"}, {"kind": "box", "size": [1, 2]}], "table": {"legs": 3}},
    {"shapes": [{"kind": "sphere"}]},
    {"shapes": [{"kind": "ball", "radius": 0}, {"kind": "box", "size": [1, "wide"], "depth": 1}]},
    {"shapes": [{"kind": "cone"}, {}, 3, {"kind": "box"}], "table": {"arms": 2}},
    {"table": 1, "chair": 2},
]


@pytest.mark.parametrize("value", VALUES)
def test_values_and_errors_are_those_of_the_plain_annotation(value, later, at_once):
    def answer(scene):
        try:
            found = scene.model_validate(value)
        except ValidationError as error:
            return [(one["loc"], one["type"], one["msg"]) for one in error.errors(include_url=False)]
        return found.model_dump(), found.model_dump_json(), found.model_dump(exclude_defaults=True)

    assert answer(later[0]) == answer(at_once[0])


def test_instances_are_taken_as_they_are(later):
    scene, (ball, _, table) = later
    shape, four_legs = ball(radius=2.0), table()
    made = scene(shapes=(shape,), table=four_legs)
    assert made.shapes[0] is shape
    assert made.table is four_legs


def test_the_schema_is_that_of_the_plain_annotation(later, at_once):
    """But for a title, the key's own name in capitals."""
    schema = later[0].model_json_schema()
    assert schema["properties"]["table"].pop("title") == "Table"
    assert schema == at_once[0].model_json_schema()
