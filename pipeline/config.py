"""What a job file may say: one table for each stage, and where the results go."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from weft.fiber_model.config import FibersConfig
from weft.fiber_model.yarns.config import YarnsConfig
from weft.files.input_file import InputFile, OutputPath
from weft.files.when_met import WhenMet
from weft.fitting.config import FitConfig
from weft.renderer.config import Camera, RenderConfig
from weft.voxelize.config import ForeignVolumeConfig, VoxelizeConfig

from .frames import refuse_what_flickers
from .job import Job, load_job
from .presets import FAMILIES
from .scattering_kinds import ScatteringTable

TURN_NAME = re.compile(r"turn_\d+")
Corner = tuple[float, float, float]


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)


class Turntable(_Table):
    """Pictures from all around."""

    frames: int = Field(ge=1, le=3600)
    """How many."""
    sweep_deg: float = 360.0
    """Angle over all of them; the picture after the last one is that many degrees from the first."""
    axis: Literal["x", "y", "z"] = "y"
    """Axis through the middle of the volume."""
    turn: Literal["cloth", "camera"] = "cloth"
    """cloth: it turns counterclockwise seen from above, with the surfaces, while camera and lights stay;
    camera: it goes around the cloth, whose lights stay with it."""

    @model_validator(mode="after")
    def _lights_turn_about_y(self) -> Turntable:
        if self.turn == "cloth" and self.axis != "y":
            raise ValueError('turn = "cloth" is about axis "y", as lights are turned about it; take "camera"')
        return self


class RenderTable(RenderConfig):
    """The picture: camera, lights, samples; and the volume, where another one than this job's is wanted."""

    volume: InputFile | None = None
    """A .vdb or .nvdb file to render in place of the one that [voxelize] makes."""
    foreign: Annotated[ForeignVolumeConfig, WhenMet()] | None = None
    """How to read `volume` where it is a .vdb file that another program wrote, such as Houdini or Blender."""
    cameras: tuple[Camera, ...] = Field(default=(), max_length=256)
    """Several pictures in place of one: cameras with names, whose pictures are JOB.NAME.exr."""
    turntable: Annotated[Turntable, WhenMet()] | None = None
    """Pictures all around, by [render.camera] as it orbits: JOB.turn_000.exr and so on."""

    @model_validator(mode="after")
    def _cameras_have_names(self) -> RenderTable:
        names = [camera.name for camera in self.cameras]
        if "" in names:
            number = names.index("") + 1
            raise ValueError(f"camera {number} of {len(names)} has no name, by which to name its picture")
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise ValueError(f"several cameras are named '{twice[0]}'")
        if self.turntable and (frame := next((name for name in names if TURN_NAME.fullmatch(name)), None)):
            raise ValueError(f"a camera is named '{frame}', as a picture of the turntable is")
        if self.turntable and self.camera.orbit_deg and self.camera.orbit_axis != self.turntable.axis:
            raise ValueError("render.camera.orbit_axis must be the turntable's axis")
        if self.cameras and not self.turntable and "camera" in self.model_fields_set:
            raise ValueError("[render.camera] has no effect beside [[render.cameras]]; make it one of them")
        return self

    @model_validator(mode="after")
    def _foreign_needs_a_volume(self) -> RenderTable:
        if self.foreign is not None and (self.volume is None or self.volume.suffix.lower() != ".vdb"):
            raise ValueError("foreign has no effect unless 'volume' names a .vdb file")
        if self.foreign is not None and self.detail_pixels is not None:
            raise ValueError("detail_pixels needs coarser levels, which only weft writes; drop foreign")
        return self


class ExportTable(_Table):
    """Which part of the fibers `weft fibers` writes as curves; all of the conditions hold."""

    format: Literal["npz", "obj"] = "npz"
    """npz: all there is to know of each curve; obj: polylines, grouped by yarn."""
    yarns: tuple[int, int] | None = None
    """First yarn and the one after the last. Default: all."""
    arc_length_mm: tuple[Annotated[float, Field(le=1e9)], Annotated[float, Field(le=1e9)]] | None = None
    """Part of each yarn, from its beginning. Default: its whole length."""
    box_mm: tuple[Corner, Corner] | None = None
    """Lower and upper corner of a box that the curves are cut to."""

    @model_validator(mode="after")
    def _ranges_rise(self) -> ExportTable:
        for name in ("yarns", "arc_length_mm"):
            part = getattr(self, name)
            if part is not None and not 0 <= part[0] < part[1]:
                raise ValueError(f"{name} must rise from 0 or more, found {list(part)}")
        if self.box_mm is not None and not all(low < high for low, high in zip(*self.box_mm, strict=True)):
            raise ValueError("the first corner of box_mm must lie below the second on every axis")
        return self


class OutputTable(_Table):
    """Where the results go, and how often they are kept on the way."""

    folder: OutputPath | None = None
    """A folder below the job's own. Default: <job name>.out beside the job."""
    checkpoint_s: float = Field(default=60.0, ge=0)
    """Time between a picture's checkpoints, which --resume goes on from; they cost no bit of it."""


class JobConfig(_Table):
    """A job of weft: yarns -> fibers -> voxelize -> render. Without its table a stage is not run."""

    include: list[str] = Field(default=[], exclude=True)
    """Job files whose values lie under this one's; paths start from this file's folder, as all paths do."""
    yarns: YarnsConfig | None = None
    """Where the centerlines come from."""
    fibers: Annotated[FibersConfig, WhenMet()] | None = None
    """Plies, fibers and fly-aways along the yarns."""
    export: Annotated[ExportTable, WhenMet()] | None = None
    """The part of the fibers to write as curves."""
    voxelize: Annotated[VoxelizeConfig, WhenMet()] | None = None
    """The sparse grid of fiber density and direction."""
    fit: Annotated[FitConfig, WhenMet()] | None = None
    """Scattering parameters from measurements, for [scattering] to take."""
    scattering: ScatteringTable | None = None
    """How a fiber scatters light; by `kind`, what the volume holds in place of fibers."""
    render: Annotated[RenderTable, WhenMet()] | None = None
    """The picture."""
    output: OutputTable = OutputTable()
    """Where the results go."""

    @model_validator(mode="after")
    def _detail_has_levels(self) -> JobConfig:
        if self.render is None or self.render.detail_pixels is None or self.render.volume is not None:
            return self
        if self.voxelize is not None and self.voxelize.levels == 0:
            raise ValueError("render.detail_pixels chooses among coarser levels: set voxelize.levels = 3")
        return self


def load(
    path: Path,
    overrides: Sequence[str] = (),
    output: Path | None = None,
    *,
    only: Sequence[str] = (),
    pending_fit: Path | None = None,
    frame: int | None = None,
) -> Job:
    """Raises `InputError` with one line for every mistake in the job. `only`: look at these tables alone.

    `pending_fit`: a file of fitted parameters that need not be there yet; a preset stands in for it.
    `frame`: of a sequence (frames.py).
    """
    job = load_job(
        path, overrides, model=JobConfig, output=output, only=only, pending_fit=pending_fit, frame=frame
    )
    if frame is not None:
        refuse_what_flickers(job.config.yarns)
    return job


def job_schema() -> dict[str, Any]:
    """JSON Schema of job files. A table that may name a preset requires no key, since a preset gives them."""
    from weft.files.key_texts import DescribedSchema

    schema = JobConfig.model_json_schema(schema_generator=DescribedSchema)
    for definition in _definitions_with_presets(schema):
        definition.pop("required", None)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **schema,
        "title": "weft job",
    }


def _definitions_with_presets(schema: dict[str, Any]) -> Iterator[dict[str, Any]]:
    for definition in schema.get("$defs", {}).values():
        if "preset" in definition.get("properties", {}):
            yield definition


assert set(FAMILIES) <= set(JobConfig.model_fields)
