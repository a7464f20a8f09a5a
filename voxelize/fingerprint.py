"""What decides the bits of a tile, as one hash: settings, fibers and the code that makes them."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

ROOMS = ("weft.fiber_model", "weft.voxelize")


def fingerprint(values: Iterable[tuple[str, Any]]) -> str:
    """SHA-256 of named arrays, configs and plain values; their order counts."""
    digest = hashlib.sha256()
    for name, value in values:
        if isinstance(value, np.ndarray):
            digest.update(f"{name} {value.dtype.descr} {value.shape}\0".encode())
            digest.update(np.ascontiguousarray(value).reshape(-1).view(np.uint8).data)
        else:
            text = value.model_dump_json() if isinstance(value, BaseModel) else repr(value)
            digest.update(f"{name} {text}\0".encode())
    return digest.hexdigest()


@cache
def code_fingerprint() -> str:
    """Of all Python code that makes fibers and voxels: after a change, tiles are made anew."""
    digest = hashlib.sha256()
    for room in ROOMS:
        spec = find_spec(room)
        for folder in (spec.submodule_search_locations or ()) if spec else ():
            for file in sorted(Path(folder).rglob("*.py")):
                content = file.read_bytes()
                digest.update(f"{file.relative_to(folder)} {len(content)}\0".encode() + content)
    return digest.hexdigest()
