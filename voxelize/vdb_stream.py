"""Reading the bricks of a .vdb file a thousand at a time, whatever its size, in a child process.

As in vdb_child.py a damaged file may hang or crash libopenvdb; here too that becomes an `InputError`. The
child writes the leaves of one grid to its output: their number, origins and values, again and again, then 0
and the transform.
"""

from __future__ import annotations

import contextlib
import os
import resource
import subprocess
import sys
from collections.abc import Container, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import numpy as np

from weft.files.errors import InputError
from weft.files.machine_memory import available_memory_bytes

from .grid import BRICK_VOXELS, CHANNELS
from .grid_files import GRID_NAMES
from .openvdb_library import extension
from .vdb import checked_voxel_size, read_summaries


@dataclass(frozen=True)
class VdbMedium:
    """What a file says of one medium, without its voxels."""

    name: str
    fiber_radius_mm: float
    grids: dict[str, str]
    """Channel -> name of its grid: density, direction, and albedo where there are colors."""


@dataclass(frozen=True)
class VdbOutline:
    """What a file that weft wrote says of itself, without its voxels."""

    content_sha256: str
    media: tuple[VdbMedium, ...]


def read_outline(path: Path) -> VdbOutline:
    """Raises `InputError` where weft did not write the file."""
    grids = {grid["name"]: grid for grid in read_summaries(path)}
    found = [
        grid for name, grid in grids.items() if name.startswith("density") and "medium" in grid["metadata"]
    ]
    if not found:
        raise InputError("no grid 'density' written by weft is in this file.", path=path)
    try:
        found.sort(key=lambda grid: int(grid["metadata"]["medium_index"]))
        media = tuple(
            VdbMedium(
                name=str(grid["metadata"]["medium"]),
                fiber_radius_mm=float(grid["metadata"]["fiber_radius_mm"]),
                grids=_grids_of(grid["name"], grids),
            )
            for grid in found
        )
        return VdbOutline(str(found[0]["metadata"]["content_sha256"]), media)
    except (KeyError, ValueError, TypeError) as error:
        raise InputError(f"the file is damaged: {error}.", path=path) from error


def _grids_of(density: str, grids: Container[str]) -> dict[str, str]:
    names = {
        channel: density.replace("density", GRID_NAMES[channel], 1)
        for channel in ("density", "direction", "albedo")
    }
    if names["direction"] not in grids:
        raise KeyError(names["direction"])
    return {channel: name for channel, name in names.items() if name in grids}


@dataclass
class BrickStream:
    """The bricks of a grid in the order of the file: origins, int32 [n, 3], values, float32 [n, 512(, 3)]."""

    path: Path
    grid: str
    channel: str
    voxel_size_mm: float | None = None
    """Known when all bricks have been read."""

    def __iter__(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        command = [sys.executable, "-P", "-m", __name__, str(self.path), self.grid]
        with subprocess.Popen(
            [*command, str(available_memory_bytes())], stdout=subprocess.PIPE, stderr=subprocess.PIPE
        ) as child:
            assert child.stdout is not None
            assert child.stderr is not None
            try:
                yield from self._batches(child.stdout)
            except ValueError as error:
                reason = f"this .vdb file cannot be read: {_complaint(child.stderr)}"
                raise InputError(reason, path=self.path) from error
            finally:
                if child.poll() is None and self.voxel_size_mm is None:
                    child.kill()

    def _batches(self, output: IO[bytes]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        width = CHANNELS[self.channel]
        shape = (BRICK_VOXELS,) if width == 1 else (BRICK_VOXELS, width)
        while count := int(_read(output, np.dtype("<i8"), (1,))[0]):
            origins = _read(output, np.dtype("<i4"), (count, 3))
            yield origins, _read(output, np.dtype("<f4"), (count, *shape))
        self.voxel_size_mm = checked_voxel_size(_read(output, np.dtype("<f8"), (16,)).tolist())


def _complaint(stream: IO[bytes]) -> str:
    lines = stream.read().decode(errors="replace").strip().splitlines()
    return f"{lines[-1]}." if lines else "its reader ended early."


def _read(stream: IO[bytes], dtype: np.dtype, shape: tuple[int, ...]) -> np.ndarray:
    array = np.empty(shape, dtype)
    view = array.reshape(-1).view(np.uint8).data
    done = 0
    while done < len(view):
        part = stream.readinto(view[done:])  # type: ignore[attr-defined]
        if not part:
            raise ValueError("the child's output ends early")
        done += part
    return array


def _main(path: str, grid: str, memory: int) -> int:
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    # the output is for the leaves alone, whatever a library prints
    output = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)

    def sink(origins: np.ndarray, values: np.ndarray) -> None:
        output.write(np.array([len(origins)], "<i8").data)
        output.write(origins.data)
        output.write(values.data)

    try:
        transform = extension().stream_grid(path, grid, sink)["index_to_world"]
        output.write(np.zeros(1, "<i8").data)
        output.write(np.array(transform, "<f8").data)
        output.close()
    except BrokenPipeError:
        with contextlib.suppress(OSError):
            output.close()
        return 2
    except Exception as error:
        print(" ".join(str(error).split()) or type(error).__name__, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(_main(sys.argv[1], sys.argv[2], int(sys.argv[3])))
