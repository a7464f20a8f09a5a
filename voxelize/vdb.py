"""Volumes in .vdb files.

Per medium a float grid `density` (fog volume) and a Vec3S grid `fiber_dir` (contravariant relative, unit
length, one hemisphere); `density_<medium>` and `fiber_dir_<medium>` where there are several. Millimeters
throughout. Files carry a content hash, since .vdb itself has no checksum. libopenvdb may hang or exhaust
memory on damaged files: they are read in a child process (vdb_child.py, vdb_reader.py) unless the caller
vouches for them.
"""

from __future__ import annotations

import hashlib
import re
import uuid
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from weft.files.atomic import atomic_write
from weft.files.errors import InputError

from .grid import CHANNELS, OPTIONAL, FiberGrid, FiberVolume
from .grid_files import GRID_NAMES, SCHEMA_VERSION, about_of, grid_name, refuse_other_content
from .openvdb_library import extension
from .stored import StoredGrid, StoredVolume
from .vdb_child import VdbReading, read_in_child

UNIQUE_ID_OFFSET = 21
"""After the magic number (8 bytes), three uint32 versions and one flag."""
UNIQUE_ID = re.compile(rb"[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}")
MAGIC = b" BDV\0\0\0\0"

NO_HASH = "0" * 64
"""Stands in place of the file's hash while it is computed."""
FILE_HASH = re.compile(rb"file_sha256\x06\0\0\0string\x40\0\0\0([0-9a-f]{64})")
"""As OpenVDB writes the metadata of the file, which stand at its beginning."""
GRID_KINDS: dict[str, dict[str, str]] = {
    "density": {"grid_class": "fog volume"},
    "direction": {"vector_type": "contravariant relative"},
    "moment_diag": {},
    "moment_off": {},
    "albedo": {},
}
"""How each channel is to be taken by other programs."""
FILE_HASH_WITHIN = 4096
CHUNK = 1 << 20


def write_volume(path: str | Path, volume: FiberVolume | StoredVolume) -> None:
    """Write the volume; the file appears whole, its values read back and found equal, or not at all.

    Of a `StoredVolume` no values are ever held but a thousand bricks'; equal content gives equal files.
    """
    path, module = Path(path), extension()
    with atomic_write(path) as temporary:
        grids = list(_leaf_grids(module, volume))
        module.write_grids(str(temporary), grids, {"file_sha256": NO_HASH})
        _set_unique_id(temporary, volume.content_sha256)
        if isinstance(volume, FiberVolume):
            # libopenvdb maps what it reads, however it is told to: no way for what does not fit in memory
            module.compare_grids(str(temporary), grids)
        _set_file_hash(temporary)


def _set_file_hash(path: Path) -> None:
    """The file's SHA-256, taken with zeros in its place, goes into the file's own metadata."""
    place, _ = _stored_hash(path)
    digest = _hash_without_hash(path, place)
    with open(path, "r+b") as file:
        file.seek(place)
        file.write(digest.encode("ascii"))


def _stored_hash(path: Path) -> tuple[int, str]:
    """Where the file's own hash stands, and the hash. `InputError` where there is none."""
    with open(path, "rb") as file:
        found = FILE_HASH.search(file.read(FILE_HASH_WITHIN))
    if found is None:
        raise InputError(
            "carries no hash of the whole file: weft did not write it, or it was changed.", path=path
        )
    return found.start(1), found.group(1).decode("ascii")


def _hash_without_hash(path: Path, place: int) -> str:
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        digest.update(file.read(place))
        digest.update(NO_HASH.encode("ascii"))
        file.seek(place + len(NO_HASH))
        while chunk := file.read(CHUNK):
            digest.update(chunk)
    return digest.hexdigest()


def refuse_changed_file(path: str | Path) -> None:
    """Raise `InputError` unless every byte is as weft wrote it, metadata and all. OpenVDB is not asked."""
    path = Path(path)
    _check_is_vdb(path)
    place, expected = _stored_hash(path)
    if _hash_without_hash(path, place) != expected:
        raise InputError(
            "the file was changed: its bytes do not agree with the file_sha256 it carries.",
            path=path,
            hint="Make it again with 'weft voxelize'.",
        )


def _set_unique_id(path: Path, content_sha256: str) -> None:
    """Replace the random UUID that OpenVDB gives every file, so that equal volumes are equal files."""
    unique_id = str(uuid.UUID(hex=content_sha256[:32], version=4)).encode("ascii")
    with open(path, "r+b") as file:
        file.seek(UNIQUE_ID_OFFSET)
        found = file.read(len(unique_id))
        if UNIQUE_ID.fullmatch(found) is None:
            raise RuntimeError(f"{path}: the UUID of a .vdb file is not where it belongs")
        file.seek(UNIQUE_ID_OFFSET)
        file.write(unique_id)


def read_volume(path: str | Path, *, verify: bool = True, trusted: bool = False) -> FiberVolume:
    """Read a volume that weft wrote; `InputError` where it is damaged or from elsewhere.

    `verify` compares the content hash. `trusted` reads in this process: faster by a second or so, but a
    damaged file may then hang or kill it.
    """
    path = Path(path)
    _check_is_vdb(path)
    return _to_volume(_read(path, trusted=trusted, with_leaves=True), path, verify=verify)


def begin_volume(path: str | Path) -> Callable[[], FiberVolume]:
    """`read_volume` begun in its child; the function returned waits for the volume."""
    path = Path(path)
    _check_is_vdb(path)
    reading = VdbReading(path, with_leaves=True)
    return lambda: _to_volume(reading.grids(), path)


def verify(path: str | Path) -> str:
    """The content hash of a file, `InputError` unless no byte was changed and the hash agrees."""
    refuse_changed_file(path)
    return read_volume(path, verify=True).content_sha256


def read_summaries(path: str | Path) -> list[dict[str, Any]]:
    """Name, type, metadata and index_to_world of every grid of any .vdb file, without its voxels."""
    path = Path(path)
    _check_is_vdb(path)
    return _read(path, trusted=False, with_leaves=False)


def read_grids(path: str | Path) -> list[dict[str, Any]]:
    """As `read_summaries`, with `leaves` (origins, masks, values) of every float and vec3s grid."""
    path = Path(path)
    _check_is_vdb(path)
    return _read(path, trusted=False, with_leaves=True)


def is_from_weft(summaries: Sequence[dict[str, Any]]) -> bool:
    """Whether the grids are those of a volume that weft wrote."""
    return any("medium_index" in grid["metadata"] for grid in summaries)


def _read(path: Path, *, trusted: bool, with_leaves: bool) -> list[dict[str, Any]]:
    if not trusted:
        return read_in_child(path, with_leaves=with_leaves)
    try:
        return extension().read_grids(str(path), with_leaves=with_leaves)
    except (RuntimeError, ValueError, KeyError, IndexError, MemoryError) as error:
        raise InputError(f"this .vdb file cannot be read: {error}", path=path) from error


def _check_is_vdb(path: Path) -> None:
    try:
        with open(path, "rb") as file:
            start = file.read(len(MAGIC))
    except OSError as error:
        raise InputError(f"cannot be opened: {error.strerror}.", path=path) from error
    if start != MAGIC:
        raise InputError("this is not a .vdb file.", path=path)


def _leaf_grids(module: ModuleType, volume: FiberVolume | StoredVolume) -> Iterable[Any]:
    """The extension's grids: voxel centers lie at h (i + 1/2)."""
    size = volume.voxel_size_mm
    grids: Mapping[str, FiberGrid | StoredGrid] = volume.grids
    for index, (medium, grid) in enumerate(grids.items()):
        metadata = {
            "fiber_radius_mm": grid.fiber_radius_mm,
            "units": "mm",
            "schema_version": SCHEMA_VERSION,
            "content_sha256": volume.content_sha256,
            "medium": medium,
            "medium_index": index,
            **volume.about,
        }
        place = {"voxel_size": size, "translation": [size / 2] * 3, "metadata": metadata}
        for channel in grid.channels:
            yield module.LeafGrid(
                grid_name(volume.media, medium, channel),
                grid.origins,
                grid.masks,
                _values(module, grid, channel),
                **place,
                **GRID_KINDS[channel],
            )


def _values(module: ModuleType, grid: FiberGrid | StoredGrid, channel: str) -> Any:
    if isinstance(grid, FiberGrid):
        return grid.channels[channel]
    paths = [str(path) for path in grid.paths]
    return module.StoredValues(paths, grid.files, grid.offsets[channel], components=CHANNELS[channel])


def _to_volume(grids: list[dict[str, Any]], path: Path, *, verify: bool = True) -> FiberVolume:
    """The volume in the grids of a file."""
    by_name = {grid["name"]: grid for grid in grids}
    densities = [
        grid for grid in grids if "medium_index" in grid["metadata"] and grid["name"].startswith("density")
    ]
    if not densities:
        raise InputError(
            f"no grid 'density' written by weft is in this file; its grids: {', '.join(by_name) or 'none'}.",
            path=path,
            hint="To render it, say in [render.foreign] how thick its fibers are (fiber_radius_mm).",
        )
    try:
        densities.sort(key=lambda grid: int(grid["metadata"]["medium_index"]))
        volume = FiberVolume(
            {
                str(grid["metadata"]["medium"]): _to_grid(
                    {
                        channel: by_name[grid["name"].replace("density", name, 1)]
                        for channel, name in GRID_NAMES.items()
                        if channel not in OPTIONAL or grid["name"].replace("density", name, 1) in by_name
                    }
                )
                for grid in densities
            },
            about=about_of(densities[0]["metadata"]),
        )
        expected = densities[0]["metadata"]["content_sha256"]
    except (KeyError, ValueError, TypeError) as error:
        raise InputError(f"the file is damaged: {error}.", path=path) from error
    if verify:
        refuse_other_content(volume, expected, path)
    return volume


def _to_grid(channels: dict[str, dict[str, Any]]) -> FiberGrid:
    """Of the file's grids, by channel."""
    density = channels["density"]
    metadata, leaves = density["metadata"], density["leaves"]
    if metadata["schema_version"] != SCHEMA_VERSION:
        raise ValueError(f"schema_version is {metadata['schema_version']}; this weft reads {SCHEMA_VERSION}")
    for channel, other in channels.items():
        if not np.array_equal(leaves["origins"], other["leaves"]["origins"]):
            raise ValueError(f"density and {GRID_NAMES[channel]} have different leaves")
    grid = FiberGrid(
        voxel_size_mm=checked_voxel_size(density["index_to_world"]),
        fiber_radius_mm=float(metadata["fiber_radius_mm"]),
        origins=leaves["origins"],
        **{channel: other["leaves"]["values"] for channel, other in channels.items()},
    )
    if not all(np.array_equal(other["leaves"]["masks"], grid.masks) for other in channels.values()):
        raise ValueError("the active voxels are not those with a density")
    return grid


def checked_voxel_size(index_to_world: list[float]) -> float:
    """Voxel size of a transform that scales by h and moves by h / 2, else `ValueError`."""
    matrix = np.array(index_to_world, dtype=np.float64)
    if matrix.shape != (16,):
        raise ValueError("the transform is not linear")
    size = float(matrix[0])
    expected = np.diag([size, size, size, 1.0])
    expected[3, :3] = size / 2
    if not np.allclose(matrix.reshape(4, 4), expected, rtol=1e-9, atol=0.0):
        raise ValueError("the transform is not a uniform scale about the origin with centered voxels")
    return size
