"""Shares of a picture: some blocks of samples of some tiles, for machines that know nothing of each other."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from weft.files.errors import InputError

from .job import Job
from .messages import shown
from .picture_volume import picture_volume
from .progress import Reporter
from .run import input_files
from .stages import CHAIN, media_scattering, scattering_by_medium
from .stop_requests import StopRequests

Window = tuple[int, int, int, int]


def render_shares(
    job: Job,
    *,
    blocks: str | None,
    tiles: str | None,
    tile_size: int,
    share: Path | None,
    resume: bool,
    report: Reporter,
) -> list[Path]:
    """Render the part of each picture of the job that `blocks` and `tiles` name; the files that hold them.

    Raises `InputError` for parts that the picture does not have.
    """
    jobs = CHAIN["render"].parts(job)
    if share is not None and len(jobs) > 1:
        raise InputError(f"--share names one file, but the job has {len(jobs)} pictures.", path=job.path)
    written = []
    for one in jobs:
        path = share or share_file(one, blocks, tiles)
        written.append(_render_share(one, blocks, tiles, tile_size, path, resume=resume, report=report))
    return written


def share_file(job: Job, blocks: str | None, tiles: str | None) -> Path:
    """Where a share goes unless told otherwise."""
    stem = Path(CHAIN["render"].outputs(job)["image"]).stem
    part = "".join(f".{name}{text.replace(':', '-')}" for name, text in (("b", blocks), ("t", tiles)) if text)
    return job.output / "shares" / f"{stem}{part}.exr"


def _render_share(
    job: Job,
    blocks: str | None,
    tiles: str | None,
    tile_size: int,
    path: Path,
    *,
    resume: bool,
    report: Reporter,
) -> Path:
    from weft.renderer.exposure import Keeping, Share
    from weft.renderer.render import run

    table = job.table("render")
    part = Share(_blocks(table, blocks), _windows(table.window, tiles, tile_size))
    volume = picture_volume(job, _volume_file(job))
    lobes = media_scattering(job, scattering_by_medium(job), volume)
    stopping = StopRequests()
    with report.work("render") as progress:
        result = run(
            table,
            volume,
            lobes,
            progress=progress,
            keeping=Keeping(path, job.config.output.checkpoint_s, resume),
            share=part,
            stopping=stopping,
        )
    if not result.complete:
        stopping.obey(f"weft: stopped; what is done is in {shown(path)}, and --resume goes on from it")
    report.finished("render", result.statistics.seconds, f"{result.statistics.paths} paths", [shown(path)])
    return path


def _volume_file(job: Job) -> Path:
    stage = CHAIN["render"]
    volume = {"volume": stage.inputs["volume"]}
    return input_files(replace(stage, inputs=volume), job, CHAIN)["volume"]


def _blocks(table: Any, text: str | None) -> range | None:
    """`0:8` as a range of blocks that the picture has."""
    if text is None:
        return None
    if table.noise is not None or table.time_s is not None:
        raise InputError("--blocks: render.noise and render.time_s do not say how many blocks there are.")
    count = -(-table.samples_per_pixel // table.block_samples)
    samples = f"{table.samples_per_pixel} samples in blocks of {table.block_samples}"
    return _range("--blocks", text, count, f"the picture has {count} blocks ({samples})")


def _windows(window: Window, text: str | None, size: int) -> tuple[Window, ...] | None:
    """Tiles of a picture, counted row by row."""
    if text is None:
        return None
    if size < 1:
        raise InputError(f"--tile-size {size}: a tile has at least one pixel.")
    left, top, width, height = window
    tiles = [
        (left + x, top + y, min(size, width - x), min(size, height - y))
        for y in range(0, height, size)
        for x in range(0, width, size)
    ]
    chosen = _range("--tiles", text, len(tiles), f"the picture has {len(tiles)} tiles of {size} pixels")
    return tuple(tiles[i] for i in chosen)


def _range(option: str, text: str, count: int, there_are: str) -> range:
    found = re.fullmatch(r"(\d{1,9}):(\d{1,9})", text)
    if found is None or not int(found[1]) < int(found[2]) <= count:
        raise InputError(f"{option} {text}: {there_are}.", hint="Write FIRST:END, as in 0:1.")
    return range(int(found[1]), int(found[2]))


def merge_files(shares: Sequence[Path], out: Path, *, partial: bool) -> str:
    """Join shares into a picture; what was made, in a line."""
    from weft.renderer.merge import merge_shares

    if out.suffix != ".exr":
        raise InputError("merge writes .exr pictures", path=out)
    if any(out.resolve() == share.resolve() for share in shares):
        raise InputError("is one of the shares; --out names the picture to write", path=out)
    merged = merge_shares(shares, partial=partial)
    merged.save(out)
    film = merged.film
    rest = "" if merged.complete else ", incomplete"
    return (
        f"merge: {film.width} x {film.height}, {film.fewest_samples} samples per pixel{rest} -> {shown(out)}"
    )
