"""Sequences: a job once for each frame of a simulation, with results in a folder of its own.

`cloth.####.obj` and `cloth.%04d.obj` in any value of a job stand for the file of a frame, and a .usd file
that moves is read at the frame as its time code. Fibers are functions of yarn and arc length, never of the
frame.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from weft.files.errors import InputError
from weft.files.input_file import TextFromFile

from .toml_source import TomlDocument

if TYPE_CHECKING:
    from .job import Job

PLACE = re.compile(r"(#{2,})|%0?(\d?)d")
"""Where the number of a frame stands in a name."""
RANGE = re.compile(r"(\d{1,7})(?::(\d{1,7})(?::(\d{1,7}))?)?")
DIGITS = 4
USD = (".usd", ".usda", ".usdc", ".usdz")
MOST_FRAMES = 100_000


def frame_numbers(text: str) -> list[int]:
    """`1:10` as the frames 1 to 10, both of them; `1:10:2` as every second; `7` as one."""
    found = RANGE.fullmatch(text)
    numbers = range(0)
    if found and int(found[3] or 1):
        numbers = range(int(found[1]), int(found[2] or found[1]) + 1, int(found[3] or 1))
    if not 1 <= len(numbers) <= MOST_FRAMES:
        raise InputError(f"--frames {text}: no frames.", hint="Write FIRST:LAST, as in 1:10; both are made.")
    return list(numbers)


def frame_folder(frame: int) -> str:
    """Of its results, below those of the job."""
    return f"frame_{frame:0{DIGITS}d}"


def at_frame(document: TomlDocument, frame: int) -> TomlDocument:
    """The values of a job at one frame."""
    table = _numbered(document.table, frame)
    yarns = table.get("yarns")
    if isinstance(yarns, dict):
        table["yarns"] = _timed(yarns, frame) | (
            {"surface": _timed(yarns["surface"], frame)} if isinstance(yarns.get("surface"), dict) else {}
        )
    return replace(document, table=table)


def _numbered(value: Any, frame: int) -> Any:
    """With the frame's number in the place of #### and %04d."""
    if isinstance(value, dict):
        return {key: _numbered(item, frame) for key, item in value.items()}
    if isinstance(value, list):
        return [_numbered(item, frame) for item in value]
    if not isinstance(value, TextFromFile) or not PLACE.search(value):
        return value
    name = PLACE.sub(lambda found: f"{frame:0{len(found[1]) if found[1] else int(found[2] or 0)}d}", value)
    return TextFromFile(name, value.folder)


def _timed(table: dict[str, Any], frame: int) -> dict[str, Any]:
    """A table that names a .usd file, read at the frame."""
    file = table.get("file")
    if isinstance(file, str) and Path(file).suffix.lower() in USD:
        return table | {"frame": frame}
    return {key: value for key, value in table.items() if key != "frame"}


def refuse_what_flickers(yarns: Any) -> None:
    """Raises `InputError` for garments whose pattern would be laid anew on the mesh of every frame."""
    surface = getattr(yarns, "surface", None)
    if surface is None or surface.kind != "mesh":
        return
    if surface.uv not in ("auto", "file") or surface.uv_unit_mm is None or yarns.grain == "up":
        raise InputError(
            "yarns.surface: yarns would jump, as the mesh of each frame would be laid flat by itself.",
            hint="Take the (u, v) of the file, with uv_unit_mm, and grain = 'uv'.",
        )


def warning_of_turning(first: Any, second: Any) -> str:
    """A line where the [yarns] of two frames are different files without yarns at rest; else empty."""
    if getattr(first, "kind", "") != "file" or first.rest is not None:
        return ""
    if (first.file, first.frame) == (second.file, second.frame):
        return ""
    return (
        "note: yarns.rest is missing: fibers may turn about their yarn from one frame to the next; "
        f"name the same yarns at rest, as rest = '{first.file.name}'"
    )


def keep_picture(job: Job, images: Iterable[str]) -> None:
    """The frame's pictures once more beside the folders of all frames, as NAME.0001.exr."""
    for name in images:
        for source in sorted(job.output.glob(f"{Path(name).stem}.*")):
            if source.suffix in (".exr", ".png") and source.stem == Path(name).stem:
                target = job.output.parent / f"{source.stem}.{job.frame:0{DIGITS}d}{source.suffix}"
                target.unlink(missing_ok=True)
                try:
                    os.link(source, target)
                except OSError:
                    shutil.copyfile(source, target)
