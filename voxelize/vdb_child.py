"""Reading a .vdb file in a child process with limits on time and memory.

libopenvdb checks little: a damaged file may hang it, exhaust memory or crash it. Here that becomes an
`InputError`. The child writes one line of JSON to its output, and puts the arrays into a file that lives in
memory, where the parent maps them.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import IO, Any

import numpy as np

from weft.files.errors import InputError
from weft.files.machine_memory import available_memory_bytes

from .openvdb_library import extension, refuse_missing_openvdb

ARRAYS: dict[str, Any] = {"origins": np.dtype("<i4"), "masks": np.dtype("<u8"), "values": np.dtype("<f4")}
READER = "weft.voxelize.vdb_reader"
SLOWEST_BYTES_PER_SECOND = 2e6
"""A file that is read more slowly than this, after a minute of grace, is taken to hang."""


class VdbReading:
    """A child that reads a file while its parent does something else.

    Begun when it is made; raises `InputError` where OpenVDB is missing or the file cannot be looked at.
    """

    def __init__(
        self,
        path: Path,
        *,
        with_leaves: bool,
        seconds: float | None = None,
        memory_bytes: int | None = None,
    ) -> None:
        refuse_missing_openvdb()
        self.path, memory = path, memory_bytes or available_memory_bytes()
        self.seconds = seconds or 60.0 + path.stat().st_size / SLOWEST_BYTES_PER_SECOND
        self.arrays = _memory_file()
        place = str(self.arrays.fileno())
        self.child = subprocess.Popen(
            [sys.executable, "-P", "-m", READER, str(path), place, str(memory), str(int(with_leaves))],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            pass_fds=[self.arrays.fileno()],
        )

    def grids(self) -> list[dict[str, Any]]:
        """As the extension's `read_grids`; `InputError` where the child fails or passes a limit."""
        with self.arrays, self.child:
            try:
                text, complaint = self.child.communicate(timeout=self.seconds)
            except subprocess.TimeoutExpired as error:
                self.child.kill()
                raise InputError(
                    f"this .vdb file is damaged: reading it took over {self.seconds:g} s.", path=self.path
                ) from error
            except BaseException:
                self.child.kill()
                raise
            if self.child.returncode != 0:
                extension()  # says so where OpenVDB itself does not load
                lines = complaint.decode(errors="replace").strip().splitlines()
                reason = lines[-1] if lines else f"its reader ended with status {self.child.returncode}"
                raise InputError(f"this .vdb file cannot be read: {reason}.", path=self.path)
            return _load_arrays(json.loads(text), self.arrays)


def read_in_child(
    path: Path, *, with_leaves: bool, seconds: float | None = None, memory_bytes: int | None = None
) -> list[dict[str, Any]]:
    """The grids of a file, or `InputError` where the child fails or passes a limit."""
    return VdbReading(path, with_leaves=with_leaves, seconds=seconds, memory_bytes=memory_bytes).grids()


def _memory_file() -> IO[bytes]:
    if hasattr(os, "memfd_create"):
        return os.fdopen(os.memfd_create("weft-vdb"), "w+b", buffering=0)
    return tempfile.TemporaryFile(buffering=0)


def _load_arrays(grids: list[dict[str, Any]], file: IO[bytes]) -> list[dict[str, Any]]:
    """Every grid with its leaves, which stay where the child has put them."""
    for grid in grids:
        places = grid.pop("places", None)
        if places is not None:
            grid["leaves"] = {name: _map_array(file, dtype, *places[name]) for name, dtype in ARRAYS.items()}
    return grids


def _map_array(file: IO[bytes], dtype: Any, offset: int, shape: list[int]) -> np.ndarray:
    if not all(shape):
        return np.empty(shape, dtype)
    return np.memmap(file, dtype, "r+", offset=offset, shape=tuple(shape)).view(np.ndarray)
