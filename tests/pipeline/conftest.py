"""A small chain of two stages, so that the machinery is tested without the work of the real ones."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import pytest
from pydantic import BaseModel, ConfigDict, Field

from weft.files.atomic import atomic_write
from weft.files.input_file import InputFile, OutputPath
from weft.pipeline.job import Job, load_job
from weft.pipeline.stage import Stage, StageInput, StageWork


class Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True, allow_inf_nan=False)


class WoolConfig(Table):
    kind: Literal["wool"] = "wool"
    file: InputFile
    strands: int = Field(default=2, gt=0)
    """How many strands."""
    size_mm: tuple[float, float] = (1.0, 2.0)
    seed: int = 0


class SilkConfig(Table):
    kind: Literal["silk"]
    gloss: float | Literal["auto"] = "auto"


class LampConfig(Table):
    kind: Literal["lamp"]
    power: float = Field(gt=0)


class SunConfig(Table):
    kind: Literal["sun"]
    file: InputFile


class ClothConfig(Table):
    color: str
    """Name of the color. More about it."""
    weight: float = Field(default=1.0, gt=0)
    lights: list[Annotated[LampConfig | SunConfig, Field(discriminator="kind")]] = []
    thread: InputFile | None = None
    by_type: dict[str, float] = {}


class OutputConfig(Table):
    folder: OutputPath | None = None


class SmallJob(Table):
    thread: Annotated[WoolConfig | SilkConfig, Field(discriminator="kind")] | None = None
    cloth: ClothConfig | None = None
    output: OutputConfig = OutputConfig()


def spin(work: StageWork) -> dict[str, object]:
    config = work.job.table("thread")
    work.progress(0.5, "spinning")
    with atomic_write(work.outputs["thread"]) as temporary:
        temporary.write_text(config.file.read_text() * config.strands)
    return {"summary": f"{config.strands} strands", "strands": config.strands}


def weave(work: StageWork) -> dict[str, object]:
    config = work.job.table("cloth")
    with atomic_write(work.outputs["cloth"]) as temporary:
        temporary.write_text(f"{config.color} {work.inputs['thread'].read_text()}")
    return {"summary": "woven"}


THREAD = Stage("thread", ("thread",), {}, lambda job: {"thread": "thread.txt"}, spin, code=("files",))
CLOTH = Stage(
    "cloth",
    ("cloth",),
    {"thread": StageInput("thread", "thread", lambda job: job.table("cloth").thread)},
    lambda job: {"cloth": "cloth.txt"},
    weave,
)

WRITTEN = """\
[thread]
kind = "wool"
file = "fleece.txt"
strands = 3

[cloth]
color = "red"
"""


class Folder:
    """A folder with a job and the file it names."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.write("fleece.txt", "wool ")
        self.job_path = self.write("job.toml", WRITTEN)
        self.output = path / "job.out"

    def write(self, name: str, text: str) -> Path:
        file = self.path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
        return file

    def load(self, *overrides: str) -> Job:
        return load_job(self.job_path, overrides, model=SmallJob)


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    return Folder(tmp_path)


@pytest.fixture
def chain() -> dict[str, Stage]:
    return {"thread": THREAD, "cloth": CLOTH}
