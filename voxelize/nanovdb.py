"""Volumes in .nvdb files, laid out and validated by warp.Volume; works without OpenVDB.

One file holds, per medium, a float grid `density` (fog volume) and a vec3f grid `fiber_dir`, named as in
vdb.py. Warp lays out the tree with all voxels of a brick active; the leaves are then filled here as whole
blocks, after NanoVDB's documented layout (NanoVDB.h 32.6, LeafData). What a .nvdb cannot say otherwise stands
as JSON in the blind data `weft` of each density grid, which other readers skip.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from weft.files.atomic import atomic_write
from weft.files.errors import InputError

from .grid import BRICK_SIZE, BRICK_VOXELS, CHANNELS, FiberGrid, FiberVolume
from .grid_files import SCHEMA_VERSION, about_of, grid_name, refuse_other_content

BLIND_NAME = b"weft"
CLASS_UNKNOWN, CLASS_FOG_VOLUME = 0, 2
TYPE_UINT8 = 26
ALIGNMENT = 32

GRID = np.dtype(
    [
        ("magic", "S8"),
        ("checksum", "<u8"),
        ("version", "<u4"),
        ("flags", "<u4"),
        ("index", "<u4"),
        ("count", "<u4"),
        ("size", "<u8"),
        ("name", "S256"),
        ("map", "V264"),
        ("world_bounds", "<f8", 6),
        ("voxel_size", "<f8", 3),
        ("grid_class", "<u4"),
        ("grid_type", "<u4"),
        ("blind_offset", "<i8"),
        ("blind_count", "<u4"),
        ("data", "V20"),
        ("node_offset", "<i8", 4),
        ("node_count", "<u4", 3),
        ("tile_count", "<u4", 3),
        ("voxel_count", "<u8"),
    ]
)
"""GridData, then TreeData; node offsets count from the latter, leaves first."""
TREE_BEGIN = 672

FILE_MAGIC = b"NanoVDB0"
FILE_HEAD = np.dtype([("magic", "S8"), ("version", "<u4"), ("count", "<u2"), ("codec", "<u2")])
"""FileHeader; codec 0 is none."""

ENTRY = np.dtype(
    [
        ("grid_bytes", "<u8"),
        ("file_bytes", "<u8"),
        ("name_key", "<u8"),
        ("voxel_count", "<u8"),
        ("grid_type", "<u4"),
        ("grid_class", "<u4"),
        ("world_bounds", "<f8", 6),
        ("index_bounds", "<i4", 6),
        ("voxel_size", "<f8", 3),
        ("name_bytes", "<u4"),
        ("node_count", "<u4", 4),
        ("tile_count", "<u4", 3),
        ("codec", "<u2"),
        ("padding", "<u2"),
        ("version", "<u4"),
    ]
)
"""FileMetaData; a name key of 0 lets readers compare the name alone, as NanoVDB's own plain writer does."""

BLIND = np.dtype(
    [
        ("offset", "<i8"),
        ("value_count", "<u8"),
        ("value_size", "<u4"),
        ("semantic", "<u4"),
        ("data_class", "<u4"),
        ("data_type", "<u4"),
        ("name", "S256"),
    ]
)
"""GridBlindMetaData; the offset counts from its own beginning."""


@dataclass(frozen=True)
class _PlannedGrid:
    name: str
    grid_class: int
    grid: FiberGrid
    values: np.ndarray
    about: dict[str, Any] | None
    """What goes into the blind data."""


def leaf_type(components: int) -> np.dtype:
    """LeafData of float (1 component) or vec3f (3)."""
    shape = () if components == 1 else (components,)
    head = [
        ("origin", "<i4", 3),
        ("extent", "u1", 3),
        ("flags", "u1"),
        ("mask", "<u8", 8),
        ("minimum", "<f4", shape),
        ("maximum", "<f4", shape),
        ("average", "<f4"),
        ("deviation", "<f4"),
    ]
    padding = -np.dtype(head).itemsize % ALIGNMENT
    return np.dtype([*head, ("padding", f"V{padding}"), ("values", "<f4", (BRICK_VOXELS, *shape))])


def write_volume(path: str | Path, volume: FiberVolume) -> None:
    """Write the volume; the file appears whole, its bytes read back and found equal, or not at all."""
    path = Path(path)
    with atomic_write(path) as temporary:
        written = _write_segment(temporary, volume)
        if _grid_hashes(temporary) != written:
            raise RuntimeError(f"{path}: the file read back differs from what was written")


def read_volume(path: str | Path, *, verify: bool = True) -> FiberVolume:
    """Read a volume that weft wrote; `InputError` where it is damaged or from elsewhere."""
    path = Path(path)
    loaded = _load(path)  # owns the memory of all the views below
    try:
        grids = _split(loaded.array().numpy())
        media = [(_blind_text(grid), grid) for grid in grids if BLIND_NAME in _blind_names(grid)]
        if not media:
            raise InputError("no grid 'density' written by weft is in this file.", path=path)
        media.sort(key=lambda pair: pair[0]["medium_index"])
        by_name = {_header(grid)["name"].item().decode(): grid for grid in grids}
        volume = FiberVolume(
            {
                about["medium"]: _to_grid(
                    about, {channel: by_name[name] for channel, name in about["channels"].items()}
                )
                for about, _ in media
            },
            about=about_of(media[0][0]),
        )
        expected = media[0][0]["content_sha256"]
    except (KeyError, ValueError, TypeError, IndexError) as error:
        raise InputError(f"the file is damaged: {error}.", path=path) from error
    if verify:
        refuse_other_content(volume, expected, path)
    return volume


def _load(path: Path) -> Any:
    """The grids of a file as a warp.Volume, their structure validated."""
    import warp as wp

    try:
        with open(path, "rb") as file:
            return wp.Volume.load_from_nvdb(file, device="cpu")
    except OSError as error:
        raise InputError(f"cannot be opened: {error.strerror}.", path=path) from error
    except Exception as error:  # Warp raises struct, zlib and plain errors alike
        raise InputError(f"this .nvdb file cannot be read: {error}.", path=path) from error


def _write_segment(path: Path, volume: FiberVolume) -> list[bytes]:
    """One segment: its head, an entry for each grid, then grid after grid; the hash of each grid."""
    plans = list(_plan_grids(volume))
    entries, hashes = b"", []
    with open(path, "wb") as file:
        file.seek(FILE_HEAD.itemsize + sum(ENTRY.itemsize + len(plan.name) + 1 for plan in plans))
        for index, plan in enumerate(plans):
            raw = _build(plan)
            header = _header(raw)
            header["index"], header["count"] = index, len(plans)
            entries += _entry(header, plan).tobytes() + plan.name.encode() + b"\0"
            hashes.append(hashlib.sha256(raw.data).digest())
            file.write(raw.data)
        head = np.zeros((), dtype=FILE_HEAD)
        head["magic"], head["version"], head["count"] = FILE_MAGIC, header["version"], len(plans)
        file.seek(0)
        file.write(head.tobytes() + entries)
    return hashes


def _entry(header: np.ndarray, plan: _PlannedGrid) -> np.ndarray:
    """What the file says of a grid ahead of it."""
    entry = np.zeros((), dtype=ENTRY)
    for name in ("version", "voxel_count", "grid_type", "grid_class", "world_bounds", "voxel_size"):
        entry[name] = header[name]
    entry["grid_bytes"] = entry["file_bytes"] = header["size"]
    entry["name_bytes"] = len(plan.name) + 1
    entry["node_count"] = [*header["node_count"], 1]
    entry["tile_count"] = header["tile_count"]
    if plan.grid.brick_count:
        origins = plan.grid.origins
        entry["index_bounds"] = [*origins.min(axis=0), *(origins.max(axis=0) + BRICK_SIZE - 1)]
    return entry


def _grid_hashes(path: Path) -> list[bytes]:
    """The hash of each grid in a file that was just written."""
    with open(path, "rb") as file:
        head = np.frombuffer(file.read(FILE_HEAD.itemsize), dtype=FILE_HEAD)[0]
        sizes = []
        for _ in range(int(head["count"])):
            entry = np.frombuffer(file.read(ENTRY.itemsize), dtype=ENTRY)[0]
            file.seek(int(entry["name_bytes"]), 1)
            sizes.append(int(entry["grid_bytes"]))
        return [hashlib.sha256(file.read(size)).digest() for size in sizes]


def _plan_grids(volume: FiberVolume) -> Iterator[_PlannedGrid]:
    for index, (medium, grid) in enumerate(volume.grids.items()):
        names = {channel: grid_name(volume.media, medium, channel) for channel in grid.channels}
        about = {
            "schema_version": SCHEMA_VERSION,
            "content_sha256": volume.content_sha256,
            "units": "mm",
            "voxel_size_mm": grid.voxel_size_mm,
            "fiber_radius_mm": grid.fiber_radius_mm,
            "brick_count": grid.brick_count,
            "medium": medium,
            "medium_index": index,
            "channels": names,
            **volume.about,
        }
        for channel, values in grid.channels.items():
            kind, text = (CLASS_FOG_VOLUME, about) if channel == "density" else (CLASS_UNKNOWN, None)
            yield _PlannedGrid(names[channel], kind, grid, values, text)


def _build(plan: _PlannedGrid) -> np.ndarray:
    """One grid as bytes: Warp lays out the tree of the bricks, then the leaves are filled."""
    import warp as wp

    grid, values = plan.grid, plan.values
    # Warp builds no tree without leaves: a grid without bricks gets one that holds nothing
    origins = grid.origins if grid.brick_count else np.zeros((1, 3), dtype=np.int32)
    size = grid.voxel_size_mm
    built = wp.Volume.allocate_by_tiles(
        wp.array(origins, dtype=wp.int32, device="cpu", copy=False),
        voxel_size=size,
        bg_value=0.0 if values.ndim == 2 else wp.vec3f(0.0, 0.0, 0.0),
        translation=(size / 2, size / 2, size / 2),
        device="cpu",
    )
    raw = built.array().numpy().copy()
    header = _header(raw)
    header["name"], header["grid_class"] = plan.name.encode(), plan.grid_class
    header["voxel_count"] = grid.voxel_count
    leaves = _leaves(raw, values)
    order = np.lexsort(leaves["origin"].T[::-1])
    if grid.brick_count:
        if not np.array_equal(leaves["origin"][order], origins):
            raise RuntimeError("warp.Volume laid out other leaves than were asked for")
        leaves["mask"][order] = grid.masks
        leaves["values"][order] = values
    else:
        leaves["mask"] = 0
    return raw if plan.about is None else _with_blind_text(raw, plan.about)


def _header(raw: np.ndarray) -> np.ndarray:
    """The head of a grid, to read and to write."""
    return raw[: GRID.itemsize].view(GRID)[0:1].reshape(())


def _leaves(raw: np.ndarray, values: np.ndarray | int) -> np.ndarray:
    """The leaves of a grid, to read and to write."""
    components = values if isinstance(values, int) else (1 if values.ndim == 2 else 3)
    kind = leaf_type(components)
    header = _header(raw)
    begin = TREE_BEGIN + int(header["node_offset"][0])
    return raw[begin : begin + int(header["node_count"][0]) * kind.itemsize].view(kind)


def _with_blind_text(raw: np.ndarray, about: dict[str, Any]) -> np.ndarray:
    """The grid with one entry of blind data, JSON, at its end."""
    text = json.dumps(about).encode()
    text += b" " * (-len(text) % ALIGNMENT)
    entry = np.zeros((), dtype=BLIND)
    entry["offset"], entry["name"] = BLIND.itemsize, BLIND_NAME
    entry["value_count"], entry["value_size"], entry["data_type"] = len(text), 1, TYPE_UINT8
    header = _header(raw)
    header["blind_offset"], header["blind_count"] = len(raw), 1
    header["size"] = len(raw) + BLIND.itemsize + len(text)
    return np.concatenate([raw, np.frombuffer(entry.tobytes() + text, dtype=np.uint8)])


def _split(buffer: np.ndarray) -> list[np.ndarray]:
    grids, begin = [], 0
    while begin < len(buffer):
        size = int(_header(buffer[begin:])["size"])
        grids.append(buffer[begin : begin + size])
        begin += max(size, GRID.itemsize)
    return grids


def _blind_entry(grid: np.ndarray) -> np.ndarray:
    begin = int(_header(grid)["blind_offset"])
    return grid[begin : begin + BLIND.itemsize].view(BLIND)[0]


def _blind_names(grid: np.ndarray) -> list[bytes]:
    return [bytes(_blind_entry(grid)["name"])] if _header(grid)["blind_count"] == 1 else []


def _blind_text(grid: np.ndarray) -> dict[str, Any]:
    entry = _blind_entry(grid)
    begin = int(_header(grid)["blind_offset"]) + int(entry["offset"])
    about = json.loads(grid[begin : begin + int(entry["value_count"])].tobytes())
    if about["schema_version"] != SCHEMA_VERSION:
        raise ValueError(f"schema_version is {about['schema_version']}; this weft reads {SCHEMA_VERSION}")
    return about


def _to_grid(about: dict[str, Any], grids: dict[str, np.ndarray]) -> FiberGrid:
    """Of the file's grids, by channel."""
    leaves = {channel: _leaves(grid, CHANNELS[channel]) for channel, grid in grids.items()}
    if not about["brick_count"]:
        leaves = {channel: found[:0] for channel, found in leaves.items()}
    origins = leaves["density"]["origin"]
    order = np.lexsort(origins.T[::-1])
    if not all(np.array_equal(origins[order], found["origin"][order]) for found in leaves.values()):
        raise ValueError("the grids of a medium have different leaves")
    return FiberGrid(
        voxel_size_mm=float(about["voxel_size_mm"]),
        fiber_radius_mm=float(about["fiber_radius_mm"]),
        origins=np.ascontiguousarray(origins[order]),
        **{channel: np.ascontiguousarray(found["values"][order]) for channel, found in leaves.items()},
    )
