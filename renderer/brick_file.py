"""A volume's bricks as the device has them, in a flat file beside the .vdb, made once: `<volume>.bricks`.

Bricks keep the order of the .vdb file. The file is their voxels (2048 bytes each), then what is known of each
brick, one line of JSON, and its length. Nothing is ever read whole but what bounds the bricks.
"""

from __future__ import annotations

import itertools
import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import IO, Any

import numpy as np

from weft.files.atomic import atomic_write
from weft.files.errors import InputError
from weft.voxelize.vdb import refuse_changed_file
from weft.voxelize.vdb_stream import BrickStream, VdbMedium, VdbOutline, read_outline

from .brick_pool import BRICK_SIZE, BRICK_VOXELS, BrickPool, add_directions, arrange_bricks, density_words

VERSION = 1
BRICK_BYTES = 4 * BRICK_VOXELS
COLUMNS = {"origins": ("<i4", 3), "density_step": ("<f4", 1), "majorant_level": ("<u4", 1)}
"""What is known of each brick: type and count."""
LENGTH_BYTES = 8


@dataclass(frozen=True)
class BrickFile:
    """A volume whose voxels stay on the disk."""

    path: Path
    header: dict[str, Any]
    """content_sha256, voxel_size_mm, media, fiber_radius_mm, and the number of bricks of each medium."""

    @property
    def media(self) -> tuple[str, ...]:
        return tuple(self.header["media"])

    @property
    def content_sha256(self) -> str:
        return str(self.header["content_sha256"])

    @property
    def brick_count(self) -> int:
        return int(sum(self.header["brick_counts"]))

    @property
    def bounds_mm(self) -> np.ndarray:
        """Corners of the box around all bricks [mm], float64, shape [2, 3]."""
        origins = self.columns["origins"]
        corners = np.stack([origins.min(axis=0), origins.max(axis=0) + BRICK_SIZE])
        return corners * float(self.header["voxel_size_mm"])

    @cached_property
    def columns(self) -> dict[str, np.ndarray]:
        """What is known of each brick, in the order of the file."""
        count, columns = self.brick_count, {}
        with open(self.path, "rb") as file:
            file.seek(count * BRICK_BYTES)
            for name, (kind, width) in COLUMNS.items():
                values = np.fromfile(file, kind, count * width)
                columns[name] = values.reshape(count, width) if width > 1 else values
        return columns

    def pool(self) -> BrickPool:
        """The same as `build_brick_pool` makes of the volume in memory, with voxels on the disk."""
        counts = self.header["brick_counts"]
        places = arrange_bricks(np.split(self.columns["origins"], np.cumsum(counts)[:-1]))
        return BrickPool(
            voxel_size_mm=float(self.header["voxel_size_mm"]),
            origin=places.origin,
            cells=places.cells,
            voxels=RowsOnDisk(self.path, places.order),
            density_step=self.columns["density_step"][places.order],
            majorant_level=self.columns["majorant_level"][places.order],
            medium=places.medium,
            fiber_radius_mm=np.array(self.header["fiber_radius_mm"]),
            layer_count=places.layer_count,
        )


class RowsOnDisk:
    """The voxel words of bricks, read when they are asked for."""

    def __init__(self, path: Path, rows: np.ndarray) -> None:
        self._file = open(path, "rb", buffering=0)  # noqa: SIM115 - stays open as long as the volume
        self._rows = rows

    def __len__(self) -> int:
        return len(self._rows)

    def __getitem__(self, bricks: Any) -> np.ndarray:
        """Of a slice or an array of bricks, uint32, shape [n, 512]. Neighbors are read at once."""
        rows = self._rows[bricks]
        order = np.argsort(rows)
        ascending = rows[order]
        found = np.empty((len(rows), BRICK_VOXELS), np.uint32)
        ends = [0, *(np.flatnonzero(np.diff(ascending) != 1) + 1).tolist(), len(rows)]
        data = found.reshape(-1).view(np.uint8).data
        for start, stop in itertools.pairwise(ends):
            _read_at(
                self._file,
                int(ascending[start]) * BRICK_BYTES,
                data[start * BRICK_BYTES : stop * BRICK_BYTES],
            )
        voxels = np.empty_like(found)
        voxels[order] = found
        return voxels


def _read_at(file: Any, place: int, data: memoryview) -> None:
    while data:
        count = os.preadv(file.fileno(), [data], place)
        if count == 0:
            raise InputError("the file ends too early; remove it.", path=file.name)
        data, place = data[count:], place + count


def open_brick_file(volume: Path) -> BrickFile:
    """The bricks of a .vdb file that weft wrote; made now where they are missing or of other content.

    Resident memory stays below a few hundred MiB, however large the volume is. Raises `InputError` where the
    .vdb file is damaged or from elsewhere.
    """
    outline = read_outline(volume)
    path = volume.with_suffix(".bricks")
    header = _header(path)
    if header is None or header["content_sha256"] != outline.content_sha256:
        refuse_changed_file(volume)
        with atomic_write(path) as temporary:
            _write(temporary, volume, outline)
        header = _header(path)
        assert header is not None
    return BrickFile(path, header)


def _header(path: Path) -> dict[str, Any] | None:
    """Of a file that is there and whole."""
    try:
        with open(path, "rb") as file:
            size = file.seek(-LENGTH_BYTES, os.SEEK_END) + LENGTH_BYTES
            length = int.from_bytes(file.read(LENGTH_BYTES), "little")
            file.seek(size - LENGTH_BYTES - length)
            header = json.loads(file.read(length))
            count = sum(header["brick_counts"])
        whole = count * (BRICK_BYTES + _column_bytes()) + length + LENGTH_BYTES
        return header if header["version"] == VERSION and size == whole else None
    except (OSError, ValueError, KeyError, TypeError, OverflowError):
        return None


def _column_bytes() -> int:
    return sum(np.dtype(kind).itemsize * width for kind, width in COLUMNS.values())


def _write(path: Path, volume: Path, outline: VdbOutline) -> None:
    columns: dict[str, list[np.ndarray]] = {name: [] for name in COLUMNS}
    counts, sizes = [], set()
    with open(path, "w+b") as file:
        for medium in outline.media:
            start, before = file.tell(), len(columns["origins"])
            density = BrickStream(volume, medium.grids["density"], "density")
            for part in _density_parts(density, medium, file):
                for name, values in part.items():
                    columns[name].append(values)
            sizes.add(density.voxel_size_mm)
            origins = np.concatenate([np.empty((0, 3), np.int32), *columns["origins"][before:]])
            counts.append(len(origins))
            _add_directions(volume, medium, file, start, origins)
            file.seek(start + len(origins) * BRICK_BYTES)
        if not sum(counts):
            raise InputError("render: the volume holds no fiber.", hint="Check yarns and voxelize.")
        if len(sizes) > 1:
            raise InputError(
                f"the media have different voxel sizes: {sorted(map(str, sizes))} mm", path=volume
            )
        for name, (kind, _) in COLUMNS.items():
            np.concatenate(columns[name]).astype(kind).tofile(file)
        _write_header(file, outline, sizes.pop(), counts)


def _write_header(file: IO[bytes], outline: VdbOutline, size: float | None, counts: list[int]) -> None:
    header = {
        "version": VERSION,
        "content_sha256": outline.content_sha256,
        "voxel_size_mm": size,
        "media": [medium.name for medium in outline.media],
        "fiber_radius_mm": [medium.fiber_radius_mm for medium in outline.media],
        "brick_counts": counts,
    }
    text = json.dumps(header).encode()
    file.write(text + len(text).to_bytes(LENGTH_BYTES, "little"))


def _density_parts(
    stream: BrickStream, medium: VdbMedium, file: IO[bytes]
) -> Iterator[dict[str, np.ndarray]]:
    """Write words without directions; what is known of each brick."""
    for origins, density in stream:
        if not (density.min() >= 0 and density.max() < np.inf):
            raise InputError(f"render: medium {medium.name} has densities that are negative or not finite.")
        words, step, level = density_words(density)
        words.tofile(file)
        yield {"origins": origins, "density_step": step, "majorant_level": level}


def _add_directions(
    volume: Path, medium: VdbMedium, file: IO[bytes], start: int, origins: np.ndarray
) -> None:
    """Into the words of one medium, which begin at `start`."""
    done = 0
    for places, direction in BrickStream(volume, medium.grids["direction"], "direction"):
        count = len(places)
        if not np.array_equal(places, origins[done : done + count]):
            raise InputError("the file is damaged: density and direction have different bricks.", path=volume)
        if not (direction.min() > -np.inf and direction.max() < np.inf):
            raise InputError(f"render: medium {medium.name} has directions that are not finite.")
        place = start + done * BRICK_BYTES
        file.seek(place)
        words = np.fromfile(file, np.uint32, count * BRICK_VOXELS).reshape(count, BRICK_VOXELS)
        add_directions(words, direction)
        file.seek(place)
        words.tofile(file)
        done += count
    if done != len(origins):
        raise InputError("the file is damaged: density and direction have different bricks.", path=volume)
