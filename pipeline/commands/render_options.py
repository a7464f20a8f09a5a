"""What `weft render` and `weft run` say about the picture beside the job: short for some `--set`."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from weft.files.errors import InputError

MOST_SAMPLES = 2**24
"""What [render] samples_per_pixel allows."""
SECONDS = {"": 1.0, "s": 1.0, "min": 60.0, "h": 3600.0}


@Parameter(name="*")
@dataclass(frozen=True)
class PictureOptions:
    """Which part of the picture, and when it is good enough."""

    crop: Annotated[tuple[int, int, int, int] | None, Parameter(negative=())] = None
    """Left, top, right and bottom of the part to render [pixels], with the bits it has in the whole."""
    samples: int | None = None
    """Paths per pixel; beside --time or --noise, the most of them."""
    time: str | None = None
    """Stop after about this time, as in 90s, 5min or 2h; without --samples, with as many as that gives."""
    noise: float | None = None
    """Stop at this standard error of a pixel, relative to the picture's mean, as in 0.02."""

    def overrides(self) -> tuple[str, ...]:
        """The same as values for --set. Raises `InputError` for a crop without pixels and an unknown unit."""
        asked: dict[str, object] = {}
        if self.crop is not None:
            asked["crop"] = crop_of(self.crop)
        if self.time is not None or self.noise is not None:
            # the job's own number is that of a picture without these rules, no bound for them
            asked["samples_per_pixel"] = MOST_SAMPLES
        if self.samples is not None:
            asked["samples_per_pixel"] = self.samples
        if self.time is not None:
            asked["time_s"] = seconds_of(self.time)
        if self.noise is not None:
            asked["noise"] = self.noise
        return tuple(f"render.{name}={value}" for name, value in asked.items())


@Parameter(name="*")
@dataclass(frozen=True)
class ShareOptions:
    """Which share of the samples, for several machines; `weft merge` joins them."""

    blocks: str | None = None
    """Blocks of render.block_samples samples, FIRST:END, as in 0:8."""
    tiles: str | None = None
    """Tiles of the picture, FIRST:END, counted row by row."""
    tile_size: int = 128
    """Width and height of a tile [pixels]."""
    share: Path | None = None
    """The file to write. Default: in the folder shares of the results, named after blocks and tiles."""


@Parameter(name="*")
@dataclass(frozen=True)
class ClusterOptions:
    """Who does the work. Extra: weft[cluster]."""

    cluster: str | None = None
    """Dask scheduler whose workers do the work, as in tcp://host:8786; or slurm, for Slurm jobs."""
    jobs: int = 1
    """With --cluster slurm, how many jobs; dask's configuration (jobqueue.slurm) says of what kind."""
    blocks_per_task: int = 1
    """Blocks that a worker of the cluster renders at a time."""
    voxel_parts: int = 1
    """Parts that workers of the cluster make of a volume's tiles."""


NO_CLUSTER_OPTIONS = ClusterOptions()
NO_SHARE_OPTIONS = ShareOptions()
NO_PICTURE_OPTIONS = PictureOptions()


def crop_of(corners: tuple[int, int, int, int]) -> list[int]:
    """Left, top, width and height, as [render] crop has them."""
    left, top, right, bottom = corners
    if not (0 <= left < right and 0 <= top < bottom):
        raise InputError(
            f"--crop {left} {top} {right} {bottom}: no pixel lies between these corners.",
            hint="Give left, top, right and bottom; the last two lie one pixel outside.",
        )
    return [left, top, right - left, bottom - top]


def seconds_of(text: str) -> float:
    """`90`, `90s`, `5min` and `2h` as seconds."""
    found = re.fullmatch(r"(\d+\.?\d*|\.\d+)\s*([a-z]*)", text.strip())
    if found is None or found[2] not in SECONDS:
        raise InputError(f"--time {text}: not a time.", hint="Write 90s, 5min or 2h.")
    return float(found[1]) * SECONDS[found[2]]
