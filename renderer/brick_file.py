"""A volume's bricks as the device has them, in a flat file beside the .vdb, made once: `<volume>.bricks`.

Bricks keep the order of the .vdb file. The file is their voxels (2048 bytes each, 4096 where the volume has
colors), then what is known of each brick, one line of JSON, and its length. Nothing is ever read whole but
what bounds the bricks.
"""

from __future__ import annotations

import itertools
import json
import os
from collections.abc import Callable, Iterator
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
from .voxel_colors import WHITE, color_words

VERSION = 1
COLUMNS = {"origins": ("<i4", 3), "density_step": ("<f4", 1), "majorant_level": ("<u4", 1)}
"""What is known of each brick: type and count."""
LENGTH_BYTES = 8


@dataclass(frozen=True)
class BrickFile:
    """A volume whose voxels stay on the disk."""

    path: Path
    header: dict[str, Any]
    """content_sha256, voxel_size_mm, media, fiber_radius_mm, brick_words, and the bricks of each."""

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
    def brick_words(self) -> int:
        """Words of one brick: 512, or 1024 with colors."""
        return _brick_words(self.header)

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
            file.seek(count * 4 * self.brick_words)
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
            voxels=RowsOnDisk(self.path, places.order, self.brick_words),
            density_step=self.columns["density_step"][places.order],
            majorant_level=self.columns["majorant_level"][places.order],
            medium=places.medium,
            fiber_radius_mm=np.array(self.header["fiber_radius_mm"]),
            layer_count=places.layer_count,
            has_colors=self.brick_words > BRICK_VOXELS,
        )


class RowsOnDisk:
    """The voxel words of bricks, read when they are asked for."""

    def __init__(self, path: Path, rows: np.ndarray, words: int) -> None:
        self._file = open(path, "rb", buffering=0)  # noqa: SIM115 - stays open as long as the volume
        self._rows, self._words = rows, words

    def __len__(self) -> int:
        return len(self._rows)

    def __getitem__(self, bricks: Any) -> np.ndarray:
        """Of a slice or an array of bricks, uint32, shape [n, 512 or 1024]. Neighbors are read at once."""
        rows = self._rows[bricks]
        order = np.argsort(rows)
        ascending = rows[order]
        found = np.empty((len(rows), self._words), np.uint32)
        size = 4 * self._words
        ends = [0, *(np.flatnonzero(np.diff(ascending) != 1) + 1).tolist(), len(rows)]
        data = found.reshape(-1).view(np.uint8).data
        for start, stop in itertools.pairwise(ends):
            _read_at(
                self._file,
                int(ascending[start]) * size,
                data[start * size : stop * size],
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
    if header is None or not _is_of(header, outline):
        refuse_changed_file(volume)
        with atomic_write(path) as temporary:
            _write(temporary, volume, outline)
        header = _header(path)
        assert header is not None
    return BrickFile(path, header)


def _brick_words(header: dict[str, Any]) -> int:
    # files from before there were colors do not say it
    return int(header.get("brick_words", BRICK_VOXELS))


def _words_of(outline: VdbOutline) -> int:
    return BRICK_VOXELS * (1 + any("albedo" in medium.grids for medium in outline.media))


def _is_of(header: dict[str, Any], outline: VdbOutline) -> bool:
    return bool(
        header["content_sha256"] == outline.content_sha256 and _brick_words(header) == _words_of(outline)
    )


def _header(path: Path) -> dict[str, Any] | None:
    """Of a file that is there and whole."""
    try:
        with open(path, "rb") as file:
            size = file.seek(-LENGTH_BYTES, os.SEEK_END) + LENGTH_BYTES
            length = int.from_bytes(file.read(LENGTH_BYTES), "little")
            file.seek(size - LENGTH_BYTES - length)
            header = json.loads(file.read(length))
            count = sum(header["brick_counts"])
        whole = count * (4 * _brick_words(header) + _column_bytes()) + length + LENGTH_BYTES
        return header if header["version"] == VERSION and size == whole else None
    except (OSError, ValueError, KeyError, TypeError, OverflowError):
        return None


def _column_bytes() -> int:
    return sum(np.dtype(kind).itemsize * width for kind, width in COLUMNS.values())


def _write(path: Path, volume: Path, outline: VdbOutline) -> None:
    columns: dict[str, list[np.ndarray]] = {name: [] for name in COLUMNS}
    counts, sizes = [], set()
    words = _words_of(outline)
    with open(path, "w+b") as file:
        for medium in outline.media:
            start, before = file.tell(), len(columns["origins"])
            density = BrickStream(volume, medium.grids["density"], "density")
            for part in _density_parts(density, medium, file, words):
                for name, values in part.items():
                    columns[name].append(values)
            sizes.add(density.voxel_size_mm)
            origins = np.concatenate([np.empty((0, 3), np.int32), *columns["origins"][before:]])
            counts.append(len(origins))
            rows = _Rows(file, start, words)
            _add(rows, BrickStream(volume, medium.grids["direction"], "direction"), origins, _fill_directions)
            if "albedo" in medium.grids:
                _add(rows, BrickStream(volume, medium.grids["albedo"], "albedo"), origins, _fill_colors)
            file.seek(start + len(origins) * 4 * words)
        if not sum(counts):
            raise InputError("render: the volume holds no fiber.", hint="Check yarns and voxelize.")
        if len(sizes) > 1:
            raise InputError(
                f"the media have different voxel sizes: {sorted(map(str, sizes))} mm", path=volume
            )
        for name, (kind, _) in COLUMNS.items():
            np.concatenate(columns[name]).astype(kind).tofile(file)
        _write_header(file, outline, sizes.pop(), counts, words)


def _write_header(
    file: IO[bytes], outline: VdbOutline, size: float | None, counts: list[int], words: int
) -> None:
    header = {
        "version": VERSION,
        "content_sha256": outline.content_sha256,
        "voxel_size_mm": size,
        "media": [medium.name for medium in outline.media],
        "fiber_radius_mm": [medium.fiber_radius_mm for medium in outline.media],
        "brick_counts": counts,
        "brick_words": words,
    }
    text = json.dumps(header).encode()
    file.write(text + len(text).to_bytes(LENGTH_BYTES, "little"))


def _density_parts(
    stream: BrickStream, medium: VdbMedium, file: IO[bytes], row_words: int
) -> Iterator[dict[str, np.ndarray]]:
    """Write words without directions, and white ones; what is known of each brick."""
    for origins, density in stream:
        if not (density.min() >= 0 and density.max() < np.inf):
            raise InputError(f"render: medium {medium.name} has densities that are negative or not finite.")
        words, step, level = density_words(density)
        white = np.full((len(words), row_words - BRICK_VOXELS), WHITE, np.uint32)
        np.concatenate([words, white], axis=1).tofile(file)
        yield {"origins": origins, "density_step": step, "majorant_level": level}


@dataclass(frozen=True)
class _Rows:
    """Where the words of one medium lie."""

    file: IO[bytes]
    start: int
    words: int


def _fill_directions(rows: np.ndarray, direction: np.ndarray) -> None:
    if not (direction.min() > -np.inf and direction.max() < np.inf):
        raise InputError("render: the volume has directions that are not finite.")
    words = np.ascontiguousarray(rows[:, :BRICK_VOXELS])
    add_directions(words, direction)
    rows[:, :BRICK_VOXELS] = words


def _fill_colors(rows: np.ndarray, albedo: np.ndarray) -> None:
    rows[:, BRICK_VOXELS:] = color_words(albedo)


def _add(
    rows: _Rows, stream: BrickStream, origins: np.ndarray, fill: Callable[[np.ndarray, np.ndarray], None]
) -> None:
    """Another channel, whose bricks are those at `origins`, into words already written."""
    done, damaged = 0, f"the file is damaged: density and {stream.channel} have different bricks."
    for places, values in stream:
        count = len(places)
        if not np.array_equal(places, origins[done : done + count]):
            raise InputError(damaged, path=stream.path)
        place = rows.start + done * 4 * rows.words
        rows.file.seek(place)
        words = np.fromfile(rows.file, np.uint32, count * rows.words).reshape(count, rows.words)
        fill(words, values)
        rows.file.seek(place)
        words.tofile(rows.file)
        done += count
    if done != len(origins):
        raise InputError(damaged, path=stream.path)
