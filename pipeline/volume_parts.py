"""Parts of a volume's tiles, made by machines that share the output folder; `weft voxelize` joins them."""

from __future__ import annotations

import re

from weft.files.errors import InputError

from .cache import stage_key, why_stale
from .camera_voxels import sized_by_camera
from .job import Job
from .run import input_files
from .stage import StageWork
from .stages import CHAIN, fiber_set, refuse_unwritable_formats, volume_paths


def make_volume_part(job: Job, text: str) -> str:
    """Finish the tiles of a part, 3/8: every eighth from the fourth; what was done, in a line.

    Takes no lock, since any number of parts may be made at once. Does nothing where the volume is fresh.
    Raises `InputError` for what is no part.
    """
    from weft.voxelize.stream import make_part

    found = re.fullmatch(r"(\d{1,6})/(\d{1,6})", text)
    if found is None or int(found[1]) >= int(found[2]):
        raise InputError(f"--part {text}: no part.", hint="Write K/N with K from 0 to N - 1, as in 0/8.")
    refuse_unwritable_formats(job)
    stage = CHAIN["voxelize"]
    inputs = input_files(stage, job, CHAIN)
    if not why_stale(stage, job, stage_key(stage, job, inputs)):
        return "voxelize: fresh"
    outputs = {name: job.output / file for name, file in stage.outputs(job).items()}
    fibers = fiber_set(StageWork(job, inputs, outputs, lambda fraction, detail: None))
    part = int(found[1]), int(found[2])
    count = make_part(sized_by_camera(job, fibers), fibers, volume_paths(outputs), part)
    return f"voxelize: {count} tiles of part {text} are finished"
