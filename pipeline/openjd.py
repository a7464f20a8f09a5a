"""Open Job Description templates (openjd-specifications, 2023-09): a job as tasks for a render farm.

Steps: the stages up to the volume, a task per share of each picture, and the merge of each picture; of a
sequence all of them for each frame. Every task is a `weft` command that can be repeated: a share goes on from
its own file.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from weft.files.atomic import atomic_write
from weft.files.errors import InputError

from .frames import DIGITS
from .job import Job
from .run import needed
from .shares import share_file
from .stages import CHAIN

SPECIFICATION = "jobtemplate-2023-09"
SECONDS_FOR_THE_CHECKPOINT = 60
"""After a task was told to end, before it is killed."""


def write_template(job: Job, path: Path, *, blocks_per_task: int, frames: Sequence[int] = ()) -> str:
    """Write the template; what it holds, in a line. Raises `InputError` for unknown numbers of samples."""
    if path.suffix != ".json":
        raise InputError("an Open Job Description template is written as .json", path=path)
    template = job_template(job, blocks_per_task, path.parent, frames)
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(template, indent=2) + "\n", encoding="utf-8")
    of_frames = f" for each of {len(frames)} frames" if frames else ""
    return f"submit: {len(template['steps'])} steps{of_frames} -> {path}"


def job_template(job: Job, blocks_per_task: int, folder: Path, frames: Sequence[int] = ()) -> dict[str, Any]:
    """The template as JSON values, for a file in `folder`, which its paths start from.

    `frames`: of a sequence, one of which `job` is.
    """
    home = job.output.parent if frames else job.output
    return {
        "specificationVersion": SPECIFICATION,
        "name": job.name,
        "parameterDefinitions": [
            {
                "name": "Weft",
                "type": "STRING",
                "default": "weft",
                "description": "The workers' command.",
            },
            _path("JobFile", "FILE", "IN", os.path.relpath(job.path, folder)),
            _path("Output", "DIRECTORY", "OUT", os.path.relpath(home, folder)),
        ],
        "steps": _steps(job, blocks_per_task, [f"{frame:0{DIGITS}d}" for frame in frames]),
    }


def _steps(job: Job, blocks_per_task: int, frames: Sequence[str]) -> list[dict[str, Any]]:
    """A step needs all tasks of those before it. `frames`: their numbers as their folders have them."""
    before = [name for name in needed(job, CHAIN, ["render"]) if name not in ("scattering", "render")]
    common = ["{{Param.JobFile}}", "--output", "{{Param.Output}}"]
    space = [{"name": "Frame", "type": "STRING", "range": list(frames)}] if frames else []
    if frames:
        common += ["--frame", "{{Task.Param.Frame}}"]
    steps = [
        _step(name, [name, *common], after=before[:i][-1:], space=space) for i, name in enumerate(before)
    ]
    ranges = block_ranges(job, blocks_per_task)
    render = ["render", *common, "--blocks", "{{Task.Param.Blocks}}", "--resume"]
    blocks = {"name": "Blocks", "type": "STRING", "range": ranges}
    steps.append(_step("render", render, after=before[-1:], space=[*space, blocks]))
    pictures = CHAIN["render"].parts(job)
    folder = "{{Param.Output}}" + ("/frame_{{Task.Param.Frame}}" if frames else "")
    for picture in pictures:
        image = CHAIN["render"].outputs(picture)["image"]
        shares = [share_file(picture, one, None).relative_to(job.output) for one in ranges]
        merge = ["merge", *(f"{folder}/{share}" for share in shares), "-o", f"{folder}/{image}"]
        name = "merge" if len(pictures) == 1 else f"merge {Path(image).stem}"
        steps.append(_step(name, merge, after=["render"], space=space))
    return steps


def block_ranges(job: Job, blocks_per_task: int) -> list[str]:
    """`0:4`, `4:8`, … up to the blocks of a picture."""
    table = job.table("render")
    if table.noise is not None or table.time_s is not None:
        raise InputError("submit: render.noise and render.time_s do not say how many blocks there are.")
    if blocks_per_task < 1:
        raise InputError(f"--blocks-per-task {blocks_per_task}: a task has at least one block.")
    count = -(-table.samples_per_pixel // table.block_samples)
    return [f"{i}:{min(i + blocks_per_task, count)}" for i in range(0, count, blocks_per_task)]


def _path(name: str, kind: str, flow: str, value: str) -> dict[str, str]:
    return {"name": name, "type": "PATH", "objectType": kind, "dataFlow": flow, "default": value}


def _step(
    name: str, arguments: list[str], *, after: list[str], space: Sequence[dict[str, Any]]
) -> dict[str, Any]:
    action = {
        "command": "{{Param.Weft}}",
        "args": arguments,
        "cancelation": {
            "mode": "NOTIFY_THEN_TERMINATE",
            "notifyPeriodInSeconds": SECONDS_FOR_THE_CHECKPOINT,
        },
    }
    step: dict[str, Any] = {"name": name, "script": {"actions": {"onRun": action}}}
    if space:
        step["parameterSpace"] = {"taskParameterDefinitions": list(space)}
    if after:
        step["dependencies"] = [{"dependsOn": one} for one in after]
    return step
