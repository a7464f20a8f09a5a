"""What a glTF file claims, checked before it is read: chunks and arrays must fit, other files be there.

Khronos glTF 2.0, sections 3.6 and 4. The reader behind this allocates what the file says.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from weft.files.errors import InputError

GLB_HEADER = struct.Struct("<4sII")
CHUNK_HEADER = struct.Struct("<II")
JSON_CHUNK = 0x4E4F534A


def external_files(path: Path) -> list[Path]:
    """Files beside a .gltf that it reads: its buffers (.bin). None for what is no readable glTF."""
    try:
        buffers = _tree(path).get("buffers", [])
        uris = [buffer.get("uri") for buffer in buffers]
    except (InputError, OSError, AttributeError, TypeError):
        return []
    return [
        path.parent / unquote(uri) for uri in uris if isinstance(uri, str) and not uri.startswith("data:")
    ]


def refuse_bad_gltf(path: Path) -> None:
    """Raise where the file is cut off, an array is larger than the data, or a file it needs is missing."""
    tree = _tree(path)
    others = external_files(path)
    missing = [other.name for other in others if not other.is_file()]
    if missing:
        raise InputError(f"needs the file '{missing[0]}', which is not there", path=path)
    most = path.stat().st_size + sum(other.stat().st_size for other in others)
    accessors = tree.get("accessors", [])
    for number, accessor in enumerate(accessors if isinstance(accessors, list) else []):
        count = accessor.get("count") if isinstance(accessor, dict) else None
        if not isinstance(count, int) or not 0 <= count <= most:
            what = f"accessor {number} has the count {count!r:.30}; the data are {most} bytes"
            raise InputError(what, path=path)


def _tree(path: Path) -> dict[str, Any]:
    """The JSON part of a .gltf or .glb file."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", path=path) from None
    text = _glb_json(data, path) if data[:4] == b"glTF" or path.suffix.lower() == ".glb" else data
    try:
        tree = json.loads(text)
    except (ValueError, RecursionError):
        raise InputError("its JSON cannot be read; is it damaged?", path=path) from None
    if not isinstance(tree, dict):
        raise InputError("is no glTF; is it damaged?", path=path)
    return tree


def _glb_json(data: bytes, path: Path) -> bytes:
    if len(data) < GLB_HEADER.size or data[:4] != b"glTF":
        raise InputError("cannot be read as .glb; is it damaged?", path=path)
    at, found = GLB_HEADER.size, b""
    while at < len(data):
        if at + CHUNK_HEADER.size > len(data):
            raise InputError("ends within a chunk; is it cut off?", path=path)
        length, kind = CHUNK_HEADER.unpack_from(data, at)
        at += CHUNK_HEADER.size
        if at + length > len(data):
            what = f"a chunk of {length} bytes does not fit the file's {len(data)}; is it cut off?"
            raise InputError(what, path=path)
        if kind == JSON_CHUNK and not found:
            found = data[at : at + length]
        at += length
    return found
