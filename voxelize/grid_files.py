"""What .vdb and .nvdb files have in common."""

from __future__ import annotations

import shutil
from pathlib import Path

from weft.files.errors import DiskSpaceError

SCHEMA_VERSION = 1
"""Of the metadata that weft adds to both kinds."""


def grid_names(media: tuple[str, ...], medium: str) -> tuple[str, str]:
    """Names of the density and the direction grid; plain, as other programs expect, for a single medium."""
    suffix = "" if len(media) == 1 else f"_{medium}"
    return f"density{suffix}", f"fiber_dir{suffix}"


def raise_if_disk_is_full(path: Path, error: Exception) -> None:
    """Raise `DiskSpaceError` from `error` where hardly anything is left on the disk of `path`."""
    if shutil.disk_usage(path.parent).free < 2**20:
        raise DiskSpaceError(
            "no space left on the disk", path=path, hint="Free some and run again."
        ) from error
