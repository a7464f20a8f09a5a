"""The levels of detail of a volume on the disk: `volume_level1.vdb`, ... beside `volume.vdb`."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from weft.files.errors import InputError
from weft.voxelize.grid import FiberVolume
from weft.voxelize.grid_files import about_of, level_path
from weft.voxelize.vdb import read_summaries

from .brick_file import BrickFile, open_brick_file
from .volume_levels import VolumeLevels


def level_files(path: Path) -> list[Path]:
    """The coarser levels that lie beside a volume, finest first."""
    beside = (level_path(path, level) for level in itertools.count(1))
    return list(itertools.takewhile(Path.is_file, beside))


def open_levels(path: Path, read: Callable[[Path], FiberVolume] | None = None) -> VolumeLevels:
    """A volume with all of its levels: their bricks in files beside them, or read into memory by `read`.

    Raises `InputError` where there are no coarser levels, or where they are of another volume.
    """
    coarser = level_files(path)
    if not coarser:
        raise InputError(
            f"render.detail_pixels: there is no {level_path(path, 1).name} beside it.",
            path=path,
            hint="Set voxelize.levels = 3 and make the volume again.",
        )
    levels: list[FiberVolume | BrickFile] = []
    errors: list[float | None] = []
    for file, (volume, about) in zip([path, *coarser], _opened([path, *coarser], read), strict=True):
        if levels and about.get("finest_content_sha256") != levels[0].content_sha256:
            raise InputError(f"is a level of another volume than {path.name}.", path=file)
        levels.append(volume)
        error = about.get("extinction_error_rms")
        errors.append(None if error is None else float(error))
    return VolumeLevels(tuple(levels), tuple(errors))


def _opened(
    files: list[Path], read: Callable[[Path], FiberVolume] | None
) -> Iterator[tuple[FiberVolume | BrickFile, Mapping[str, Any]]]:
    """Volumes and what their files say of them."""
    for file in files:
        if read is not None:
            volume = read(file)
            yield volume, volume.about
        else:
            metadata = [grid["metadata"] for grid in read_summaries(file)]
            yield open_brick_file(file), about_of(metadata[0] if metadata else {})
