"""One job, several pictures: each camera and each frame of a turntable is a result of its own."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .job import Job

if TYPE_CHECKING:
    from weft.renderer.film import Film
    from weft.renderer.progress import Watch


def jobs_of_pictures(job: Job) -> list[Job]:
    """The job once for each of its pictures, as if it had that camera alone."""
    table = job.table("render")
    if not table.cameras and table.turntable is None:
        return [job]
    views = [*({"camera": camera} for camera in table.cameras), *_turned(table)]
    return [_with(job, view) for view in views]


def _turned(table: Any) -> Iterator[dict[str, Any]]:
    """What of [render] a picture of the turntable has of its own."""
    turntable = table.turntable
    if turntable is None:
        return
    for frame in range(turntable.frames):
        angle = turntable.sweep_deg * frame / turntable.frames
        if turntable.turn == "cloth":
            # the cloth turns: camera and lights go the other way around it
            angle = -angle
        camera = {
            "name": f"turn_{frame:03}",
            "orbit_deg": table.camera.orbit_deg + angle,
            "orbit_axis": turntable.axis,
        }
        lights = table.lights_turn_deg + (angle if turntable.turn == "cloth" else 0.0)
        yield {"camera": table.camera.model_copy(update=camera), "lights_turn_deg": lights}


def _with(job: Job, view: dict[str, Any]) -> Job:
    table = job.table("render").model_copy(update={"cameras": (), "turntable": None, **view})
    return replace(job, config=job.config.model_copy(update={"render": table}))


@contextmanager
def unfinished_picture(image: Path, exposure: float) -> Iterator[Watch]:
    """Show the picture while it is made, in IMAGE.rendering.png beside it, which is gone at the end."""
    from weft.renderer.image import write_preview
    from weft.renderer.progress import Watch, radiance_so_far

    path = image.with_suffix(".rendering.png")

    def show(film: Film) -> None:
        write_preview(path, radiance_so_far(film), exposure=exposure)

    try:
        yield Watch(show)
    finally:
        path.unlink(missing_ok=True)


def picture_files(job: Job) -> dict[str, str]:
    """Names of the files of a job's one picture."""
    name = job.table("render").camera.name
    stem = f"{job.name}.{name}" if name else "image"
    return {"image": f"{stem}.exr", "preview": f"{stem}.png"}
