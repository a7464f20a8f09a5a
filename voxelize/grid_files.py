"""What .vdb and .nvdb files have in common."""

from __future__ import annotations

SCHEMA_VERSION = 1
"""Of the metadata that weft adds to both kinds."""


def grid_names(media: tuple[str, ...], medium: str) -> tuple[str, str]:
    """Names of the density and the direction grid; plain, as other programs expect, for a single medium."""
    suffix = "" if len(media) == 1 else f"_{medium}"
    return f"density{suffix}", f"fiber_dir{suffix}"
