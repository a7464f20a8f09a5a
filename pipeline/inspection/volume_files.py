"""What `weft inspect` says of volumes and pictures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from weft.files.errors import InputError

from .facts import Facts, bounds, value_range

if TYPE_CHECKING:
    from weft.voxelize.grid import FiberGrid


def volume_facts(path: Path) -> Facts:
    from weft.pipeline.picture_volume import load_volume

    if path.suffix.lower() == ".vdb":
        from weft.voxelize.vdb import is_from_weft, read_summaries

        summaries = read_summaries(path)
        if not is_from_weft(summaries):
            return _foreign_facts(summaries)
    volume = load_volume(path)
    media = {
        name: {
            "bricks": grid.brick_count,
            "voxels": grid.voxel_count,
            "volume fraction": value_range(grid.density),
            "fiber radius [mm]": grid.fiber_radius_mm,
            "fiber length [mm]": grid.fiber_length_mm,
            **_mean_color(grid),
        }
        for name, grid in volume.grids.items()
    }
    return {
        "content": "fiber volume",
        "voxel size [mm]": volume.voxel_size_mm,
        **bounds(volume.bounds_mm),
        "media": media,
        **{name.replace("_", " "): value for name, value in volume.about.items()},
        # reading refuses files whose content and hash disagree
        "content hash": volume.content_sha256,
    }


def _mean_color(grid: FiberGrid) -> Facts:
    if grid.albedo is None:
        return {}
    weight = grid.density.astype(np.float64)
    return {"mean color": (np.einsum("bv,bvc->c", weight, grid.albedo) / max(weight.sum(), 1e-300)).tolist()}


def _foreign_facts(summaries: list[dict[str, Any]]) -> Facts:
    """Of a .vdb file of another program, in the unit of the file."""
    grids = {}
    for index, grid in enumerate(summaries):
        matrix = np.array(grid["index_to_world"]).reshape(-1, 4)
        sizes = np.linalg.norm(matrix[:3, :3], axis=1).tolist() if len(matrix) == 4 else []
        grids[grid["name"] or f"(grid {index})"] = {
            "type": grid["type"],
            "class": grid["metadata"].get("class", "unknown"),
            "voxel size [file units]": sizes[0] if sizes and np.ptp(sizes) < 1e-6 * sizes[0] else sizes,
            **{
                name: grid["metadata"][name]
                for name in ("creator", "file_voxel_count")
                if name in grid["metadata"]
            },
        }
    return {
        "content": "volume of another program",
        "grids": grids,
        "to render it": "[render.foreign] with fiber_radius_mm; density, direction where names are unusual",
    }


def exr_facts(path: Path) -> Facts:
    from weft.renderer.image import read_exr

    channels, attributes = read_exr(path)
    shape = next(iter(channels.values())).shape if channels else (0, 0)
    simple = {name: value for name, value in attributes.items() if isinstance(value, (str, int, float))}
    return {
        "content": "image",
        "size": f"{shape[1]} x {shape[0]}",
        "channels": {
            name: value_range(np.asarray(data, dtype=np.float64)) for name, data in channels.items()
        },
        "not finite": int(sum((~np.isfinite(data)).sum() for data in channels.values())),
        "attributes": simple,
    }


def png_facts(path: Path) -> Facts:
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(path, formats=["PNG"]) as image:
            image.verify()
            return {"content": "image", "size": f"{image.width} x {image.height}", "mode": image.mode}
    except (OSError, SyntaxError, ValueError, UnidentifiedImageError) as error:
        raise InputError(f"is not a readable PNG file: {error}", path=path) from error
