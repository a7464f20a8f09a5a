"""Open Job Description templates (openjd-specifications, 2023-09): a job as tasks for a render farm.

Steps: the stages up to the volume, a task per share of each picture, and the merge of each picture. Every
task is a `weft` command that can be repeated: a share goes on from its own file.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from weft.files.atomic import atomic_write
from weft.files.errors import InputError

from .job import Job
from .run import needed
from .shares import share_file
from .stages import CHAIN

SPECIFICATION = "jobtemplate-2023-09"
SECONDS_FOR_THE_CHECKPOINT = 60
"""After a task was told to end, before it is killed."""


def write_template(job: Job, path: Path, *, blocks_per_task: int) -> str:
    """Write the template; what it holds, in a line. Raises `InputError` for unknown numbers of samples."""
    if path.suffix != ".json":
        raise InputError("an Open Job Description template is written as .json", path=path)
    template = job_template(job, blocks_per_task, path.parent)
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(template, indent=2) + "\n", encoding="utf-8")
    return f"submit: {len(template['steps'])} steps -> {path}"


def job_template(job: Job, blocks_per_task: int, folder: Path) -> dict[str, Any]:
    """The template as JSON values, for a file in `folder`, which its paths start from."""
    pictures = CHAIN["render"].parts(job)
    before = [name for name in needed(job, CHAIN, ["render"]) if name not in ("scattering", "render")]
    steps = [
        _step(name, [name, "{{Param.JobFile}}", *_output()], after=before[:i][-1:])
        for i, name in enumerate(before)
    ]
    ranges = block_ranges(job, blocks_per_task)
    render = ["render", "{{Param.JobFile}}", *_output(), "--blocks", "{{Task.Param.Blocks}}", "--resume"]
    space = {"taskParameterDefinitions": [{"name": "Blocks", "type": "STRING", "range": ranges}]}
    steps.append(_step("render", render, after=before[-1:]) | {"parameterSpace": space})
    for picture in pictures:
        image = CHAIN["render"].outputs(picture)["image"]
        shares = [share_file(picture, blocks, None).relative_to(job.output) for blocks in ranges]
        merge = ["merge", *(f"{{{{Param.Output}}}}/{share}" for share in shares)]
        name = "merge" if len(pictures) == 1 else f"merge {Path(image).stem}"
        steps.append(_step(name, [*merge, "-o", f"{{{{Param.Output}}}}/{image}"], after=["render"]))
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
            _path("Output", "DIRECTORY", "OUT", os.path.relpath(job.output, folder)),
        ],
        "steps": steps,
    }


def block_ranges(job: Job, blocks_per_task: int) -> list[str]:
    """`0:4`, `4:8`, … up to the blocks of a picture."""
    table = job.table("render")
    if table.noise is not None or table.time_s is not None:
        raise InputError("submit: render.noise and render.time_s do not say how many blocks there are.")
    if blocks_per_task < 1:
        raise InputError(f"--blocks-per-task {blocks_per_task}: a task has at least one block.")
    count = -(-table.samples_per_pixel // table.block_samples)
    return [f"{i}:{min(i + blocks_per_task, count)}" for i in range(0, count, blocks_per_task)]


def _output() -> list[str]:
    return ["--output", "{{Param.Output}}"]


def _path(name: str, kind: str, flow: str, value: str) -> dict[str, str]:
    return {"name": name, "type": "PATH", "objectType": kind, "dataFlow": flow, "default": value}


def _step(name: str, arguments: list[str], *, after: list[str]) -> dict[str, Any]:
    action = {
        "command": "{{Param.Weft}}",
        "args": arguments,
        "cancelation": {
            "mode": "NOTIFY_THEN_TERMINATE",
            "notifyPeriodInSeconds": SECONDS_FOR_THE_CHECKPOINT,
        },
    }
    step: dict[str, Any] = {"name": name, "script": {"actions": {"onRun": action}}}
    if after:
        step["dependencies"] = [{"dependsOn": one} for one in after]
    return step
