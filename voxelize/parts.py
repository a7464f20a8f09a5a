"""Finished tiles in a folder beside the result, so that a run which was killed goes on where it stood.

One file per tile: a line of JSON, the index of its bricks (origins, masks, digests), then the values of each
channel in voxels with fiber, and at the end the SHA-256 of all before it. A file appears whole or not at all;
one that is damaged, or of another job, is made anew. So any number of processes may work in the folder.
"""

from __future__ import annotations

import hashlib
import io
import json
import shutil
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from weft.files.atomic import atomic_write

from .grid import CHANNELS, brick_digests, empty_values, occupied
from .native_tiles import active_values

if TYPE_CHECKING:
    from .accumulator import BrickBatch

PART_VERSION = 1
CHUNK = 1 << 20
INDEX = {"origins": ("<i4", 3), "masks": ("<u8", 8), "digests": ("u1", 32)}
"""What stands of each brick before the values: type and count."""


@dataclass(frozen=True)
class TilePart:
    """What is known of a finished tile without its bricks."""

    number: int
    medium: int
    brick_count: int
    voxel_count: int
    """Voxels with fiber."""
    channels: list[str]
    generated_units: int
    """Fiber length made in this tile first, as `Source.accumulate` returns it."""
    density_sum: float
    max_density: float
    overfull_voxel_count: int


@dataclass(frozen=True)
class PartIndex:
    """The bricks of a finished tile and where in its file their values begin."""

    origins: np.ndarray
    masks: np.ndarray
    digests: np.ndarray
    offsets: dict[str, np.ndarray]
    """Per channel, bytes from the file's beginning, int64, shape [brick_count]."""


class PartFolder:
    """The finished tiles of one job, told from those of any other by `key`."""

    def __init__(self, folder: Path, key: str) -> None:
        self.folder, self._key = folder, key

    def open(self) -> dict[int, TilePart]:
        """The finished tiles that are there, by number; files of other jobs are removed.

        What others are writing, under temporary names with a dot, stays.
        """
        parts = {}
        for file in sorted(self.folder.glob("[!.]*")) if self.folder.is_dir() else ():
            part = self._read(file)
            if part is None or file != self.path(part.number):
                file.unlink(missing_ok=True)
            else:
                parts[part.number] = part
        return parts

    def path(self, number: int) -> Path:
        return self.folder / f"tile_{number:06d}.part"

    def write(self, number: int, medium: int, batch: BrickBatch, generated_units: int) -> TilePart:
        """Store a tile; `OSError` or `InputError` where that fails, and nothing is left of it."""
        masks = occupied(batch.density)
        part = TilePart(
            number=number,
            medium=medium,
            brick_count=len(batch.origins),
            voxel_count=int(np.bitwise_count(masks).sum()),
            channels=list(batch.channels),
            generated_units=generated_units,
            density_sum=float(batch.density.sum(dtype=np.float64)),
            max_density=float(batch.density.max(initial=0.0)),
            overfull_voxel_count=int(np.count_nonzero(batch.density > 1)),
        )
        header = json.dumps({"version": PART_VERSION, "key": self._key, **asdict(part)}).encode() + b"\n"
        digests = brick_digests(batch.origins, batch.channels.values())
        with atomic_write(self.path(number)) as temporary, open(temporary, "wb", buffering=0) as file:
            digest = hashlib.sha256(header)
            _write_all(file, header)
            for name, array in (("origins", batch.origins), ("masks", masks), ("digests", digests)):
                _append(file, digest, np.ascontiguousarray(array, dtype=INDEX[name][0]))
            for channel in batch.channels.values():
                _append(file, digest, active_values(channel, masks))
            _write_all(file, digest.digest())
        return part

    def index(self, part: TilePart) -> PartIndex:
        """Of a tile that `write` or `open` returned."""
        with open(self.path(part.number), "rb") as file:
            file.readline()
            arrays = {
                name: np.fromfile(file, dtype=kind, count=part.brick_count * width).reshape(-1, width)
                for name, (kind, width) in INDEX.items()
            }
            begin = file.tell()
        voxels = np.bitwise_count(arrays["masks"]).sum(axis=1, dtype=np.int64)
        before = np.cumsum(voxels) - voxels
        offsets = {}
        for name in part.channels:
            offsets[name] = begin + before * 4 * CHANNELS[name]
            begin += part.voxel_count * 4 * CHANNELS[name]
        return PartIndex(**arrays, offsets=offsets)

    def values(self, part: TilePart) -> dict[str, np.ndarray]:
        """The channels of a tile as whole bricks, float32, shape [brick_count, 512(, 3)]."""
        index = self.index(part)
        inside = np.unpackbits(index.masks.view(np.uint8), axis=1, bitorder="little").astype(bool)
        found = {}
        for name in part.channels:
            width = CHANNELS[name]
            begin = int(index.offsets[name][0]) if part.brick_count else 0
            packed = np.fromfile(self.path(part.number), "<f4", count=part.voxel_count * width, offset=begin)
            found[name] = empty_values(part.brick_count, name)
            found[name][inside] = packed.reshape((-1,) if width == 1 else (-1, width))
        return found

    def remove(self) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)

    def _read(self, file: Path) -> TilePart | None:
        """The tile in a file of this job that is whole and undamaged."""
        try:
            with open(file, "rb") as stream:
                header = json.loads(stream.readline(CHUNK))
                if header.pop("version") != PART_VERSION or header.pop("key") != self._key:
                    return None
                part = TilePart(**header)
            return part if _is_whole(file) else None
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return None


def _write_all(file: io.FileIO, data: bytes | memoryview) -> None:
    view = memoryview(data)
    while view:
        view = view[file.write(view) :]


def _append(file: io.FileIO, digest: Any, array: np.ndarray) -> None:
    data = array.reshape(-1).view(np.uint8).data
    digest.update(data)
    _write_all(file, data)


def _is_whole(file: Path) -> bool:
    """Whether the file ends with the hash of what stands before."""
    length = hashlib.sha256().digest_size
    digest, left = hashlib.sha256(), file.stat().st_size - length
    with open(file, "rb") as stream:
        for block in _blocks(stream, left):
            digest.update(block)
        return left >= 0 and stream.read() == digest.digest()


def _blocks(stream: IO[bytes], count: int) -> Iterator[bytes]:
    while count > 0:
        block = stream.read(min(CHUNK, count))
        if not block:
            return
        count -= len(block)
        yield block
