"""The plainest command lines, as `weft render job.toml --force`, read without cyclopts.

Loading it and laying out a command's forty options takes longer than reading the job. Here is understood only
what cannot mean anything else; all other lines, and all mistakes, are cyclopts' to read.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

STAGES = ("yarns", "fibers", "voxelize", "render")
FLAGS = ("--force", "--resume")
VALUES = ("--set", "--output", "-o", "--progress")
PROGRESS = ("auto", "bar", "plain", "json")
"""As `ShowProgress` of options.py."""


def plain_stage(arguments: Sequence[str]) -> Callable[[], None] | None:
    """What the line asks for, or None where it is not plain."""
    name, *words = arguments or [""]
    given: dict[str, list[str]] = {}
    waiting = iter(words)
    for word in waiting:
        option, has_value, value = word.partition("=") if word.startswith("--") else (word, "", "")
        if option in VALUES:
            value = value if has_value else next(waiting, "")
        elif word in FLAGS or not word.startswith("-"):
            option, value = (word, "yes") if word in FLAGS else ("job", word)
        else:
            return None
        if not value or value.startswith("-"):
            return None
        given.setdefault("--output" if option == "-o" else option, []).append(value)
    overrides = given.pop("--set", [])
    one = {option: values[0] for option, values in given.items() if len(values) == 1}
    progress = one.get("--progress", "auto")
    if name not in STAGES or "job" not in one or len(one) < len(given) or progress not in PROGRESS:
        return None
    return partial(
        run_stage,
        name,
        Path(one["job"]),
        overrides,
        Path(one["--output"]) if "--output" in one else None,
        force="--force" in one,
        resume="--resume" in one,
        progress=progress,
    )


def run_stage(
    name: str,
    job: Path,
    overrides: Sequence[str],
    output: Path | None,
    *,
    force: bool,
    resume: bool,
    progress: str,
    frame: int | None = None,
) -> None:
    """Make the results of one stage."""
    from weft.pipeline.config import load
    from weft.pipeline.progress import reporter
    from weft.pipeline.run import run_one
    from weft.pipeline.stages import CHAIN

    loaded = load(job, overrides, output, frame=frame)
    run_one(loaded, CHAIN, name, report=reporter(progress), force=force, resume=resume)
