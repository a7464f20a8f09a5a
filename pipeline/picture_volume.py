"""The volume that a picture shows: in memory, on the disk, or at several levels of detail."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from weft.files.errors import InputError

from .cache import stamp_of
from .job import Job
from .warp_start import start_warp

if TYPE_CHECKING:
    from weft.renderer.scene import AnyVolume
    from weft.voxelize.config import ForeignVolumeConfig
    from weft.voxelize.grid import FiberVolume

BYTES_PER_FILE_BYTE = 4
"""What a volume takes in memory by the size of its .vdb file: of a twill, 3.9 times as much."""


def picture_volume(job: Job, path: Path) -> AnyVolume:
    """On the disk where the device holds a part of it; what is to be cut or converted, in memory."""
    return begin_picture_volume(job, path)()


def begin_picture_volume(job: Job, path: Path) -> Callable[[], AnyVolume]:
    """The same, begun where that goes beside other work; the function returned waits for it."""
    table = job.table("render")
    own = path.suffix == ".vdb" and table.foreign is None and table.stencil is None
    in_part = table.brick_pool_mb is not None or table.detail_pixels is not None or _larger_than_memory(path)
    levels = tuple(stamp_of(file).sha256 for file in _levels_of(job, path))
    hashes = (stamp_of(path).sha256, *levels)
    return _kept_volume(path, hashes, table.foreign, own and in_part, table.detail_pixels is not None)


def _larger_than_memory(path: Path) -> bool:
    """Whether a volume of ours would not fit in this machine's memory; it is then read from the disk."""
    from weft.files.machine_memory import available_memory_bytes

    return path.stat().st_size * BYTES_PER_FILE_BYTE > available_memory_bytes()


def _levels_of(job: Job, volume: Path) -> list[Path]:
    """Files of the coarser levels that a picture chooses from."""
    if job.table("render").detail_pixels is None:
        return []
    from weft.renderer.level_files import level_files

    return level_files(volume)


def level_hashes(job: Job) -> dict[str, Any]:
    """What a picture's bits depend on besides its volume, where it chooses among levels of detail."""
    if not job.has("render") or job.table("render").detail_pixels is None:
        return {}
    suffix = job.table("voxelize").formats[0] if job.has("voxelize") else "vdb"
    volume = job.table("render").volume or job.output / f"volume.{suffix}"
    files = enumerate(_levels_of(job, volume), start=1)
    return {f"input.volume level {level}": f"sha256:{stamp_of(file).sha256}" for level, file in files}


@lru_cache(maxsize=1)
def _kept_volume(
    path: Path, sha256: tuple[str, ...], foreign: ForeignVolumeConfig | None, on_disk: bool, in_levels: bool
) -> Callable[[], AnyVolume]:
    """A volume is read once for all pictures of a run, or laid out in a file of bricks beside it.

    `sha256`: of its file, and of those of its levels where these are wanted.
    """
    begun = [_begin_volume(path, foreign, on_disk, in_levels)]

    @cache  # keeps no errors: whoever asks again reads again
    def volume() -> AnyVolume:
        return (begun.pop() if begun else _begin_volume(path, foreign, on_disk, in_levels))()

    return volume


def _begin_volume(
    path: Path, foreign: ForeignVolumeConfig | None, on_disk: bool, in_levels: bool
) -> Callable[[], AnyVolume]:
    if in_levels:
        from weft.renderer.level_files import open_levels

        return partial(open_levels, path, None if on_disk else load_volume)
    if on_disk:
        from weft.renderer.brick_file import open_brick_file

        return partial(open_brick_file, path)
    if foreign is None and path.suffix == ".vdb":
        from weft.voxelize.vdb import begin_volume

        return begin_volume(path)
    return partial(load_volume, path, foreign)


def load_volume(path: Path, foreign: ForeignVolumeConfig | None = None) -> FiberVolume:
    """By its suffix; `foreign` for what another program wrote. `InputError` for other kinds of file."""
    if foreign is not None:
        from weft.voxelize.foreign import read_foreign

        return read_foreign(path, foreign)
    if path.suffix == ".nvdb":
        from weft.voxelize.nanovdb import read_volume as read_nvdb

        start_warp()
        return read_nvdb(path)
    if path.suffix == ".vdb":
        from weft.voxelize.vdb import read_volume as read_vdb

        return read_vdb(path)
    raise InputError("is neither a .vdb nor a .nvdb file", path=path)
