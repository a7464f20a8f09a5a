"""Parts of a file joined to one mesh."""

from __future__ import annotations

import numpy as np


def joined_parts(
    parts: list[tuple[np.ndarray, np.ndarray, np.ndarray | None]],
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """One mesh of several; with (u, v) only if all have them."""
    starts = np.cumsum([0] + [len(vertices) for vertices, _, _ in parts])
    uvs = [uv for _, _, uv in parts if uv is not None]
    return (
        np.concatenate([vertices for vertices, _, _ in parts]),
        np.concatenate([faces + start for (_, faces, _), start in zip(parts, starts[:-1], strict=True)]),
        np.concatenate(uvs) if len(uvs) == len(parts) else None,
    )
