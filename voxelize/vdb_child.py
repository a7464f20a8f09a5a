"""Reading a .vdb file in a child process with limits on time and memory.

libopenvdb checks little: a damaged file may hang it, exhaust memory or crash it. Here that becomes an
`InputError`. The child writes one line of JSON to its output, and puts the arrays into a file that lives in
memory, where the parent maps them.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import IO, Any

import numpy as np

from weft.files.errors import InputError
from weft.files.machine_memory import available_memory_bytes

from .openvdb_library import extension

ARRAYS: dict[str, Any] = {"origins": np.dtype("<i4"), "masks": np.dtype("<u8"), "values": np.dtype("<f4")}
SLOWEST_BYTES_PER_SECOND = 2e6
"""A file that is read more slowly than this, after a minute of grace, is taken to hang."""


def read_in_child(
    path: Path, *, with_leaves: bool, seconds: float | None = None, memory_bytes: int | None = None
) -> list[dict[str, Any]]:
    """What the extension's `read_grids` gives, or `InputError` where the child fails or passes a limit."""
    memory = memory_bytes or available_memory_bytes()
    limit = seconds or 60.0 + path.stat().st_size / SLOWEST_BYTES_PER_SECOND
    with _memory_file() as arrays:
        command = [sys.executable, "-P", "-m", __name__, str(path), str(arrays.fileno()), str(memory)]
        try:
            child = subprocess.run(
                [*command, str(int(with_leaves))],
                stdin=subprocess.DEVNULL,
                capture_output=True,
                timeout=limit,
                pass_fds=[arrays.fileno()],
                check=False,
            )
        except subprocess.TimeoutExpired as error:
            raise InputError(
                f"this .vdb file is damaged: reading it took over {limit:g} s.", path=path
            ) from error
        if child.returncode != 0:
            complaint = child.stderr.decode(errors="replace").strip().splitlines()
            reason = complaint[-1] if complaint else f"its reader ended with status {child.returncode}"
            raise InputError(f"this .vdb file cannot be read: {reason}.", path=path)
        return _load_arrays(json.loads(child.stdout), arrays)


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


def _main(path: str, arrays: int, memory: int, with_leaves: bool) -> int:
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    # the output is for the JSON alone, whatever a library prints
    output = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    try:
        grids = extension().read_grids(path, with_leaves=with_leaves, arrays_file=arrays)
        json.dump(grids, output)
        output.close()
    except Exception as error:
        print(" ".join(str(error).split()) or type(error).__name__, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(_main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), bool(int(sys.argv[4]))))
