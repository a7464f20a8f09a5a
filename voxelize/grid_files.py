"""What .vdb and .nvdb files have in common."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from weft.files.errors import InputError

from .grid import FiberVolume

SCHEMA_VERSION = 2
"""Of the metadata that weft adds to both kinds."""


GRID_NAMES = {
    "density": "density",
    "direction": "fiber_dir",
    "moment_diag": "moment_diag",
    "moment_off": "moment_off",
    "albedo": "albedo",
}
"""What the channels are called in files."""


ABOUT = (
    "level",
    "level_lobes",
    "finest_content_sha256",
    "extinction_error_mean",
    "extinction_error_rms",
)
"""Metadata of a coarser level: which it is, of what, and by how much its extinction differs from that."""


SECOND_LOBE = "_crossing"
"""Of a coarser level, what ends the name of the medium that holds the second direction of another."""


def level_path(path: Path, level: int) -> Path:
    """`volume_level2.vdb` beside `volume.vdb`."""
    return path.with_name(f"{path.stem}_level{level}{path.suffix}")


def base_medium(name: str, media: Sequence[str]) -> str:
    """The medium whose second lobe this is; itself, where it is none."""
    base = name.removesuffix(SECOND_LOBE)
    return base if base in media else name


def about_of(metadata: Mapping[str, Any]) -> dict[str, str | int | float]:
    """What a file says of its volume besides."""
    return {name: metadata[name] for name in ABOUT if name in metadata}


def grid_name(media: tuple[str, ...], medium: str, channel: str) -> str:
    """Name of the grid of a channel; plain, as other programs expect, for a single medium."""
    return GRID_NAMES[channel] if len(media) == 1 else f"{GRID_NAMES[channel]}_{medium}"


def refuse_other_content(volume: FiberVolume, content_sha256: str, path: Path) -> None:
    """Raise `InputError` where the voxels are not those whose hash the file carries."""
    if volume.content_sha256 != content_sha256:
        raise InputError(
            "the file is damaged: its voxels do not agree with the content_sha256 it carries.",
            path=path,
            hint="Make it again with 'weft voxelize'.",
        )
