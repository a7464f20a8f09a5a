"""What a .ply file claims, checked before it is read: as many elements as it says must fit in it."""

from __future__ import annotations

import re
from pathlib import Path

from weft.files.errors import InputError

HEADER_BYTES = 1 << 16
CHUNK = 1 << 24
ELEMENT = re.compile(rb"^element +(\S+) +(-?\d+)", re.MULTILINE)


def refuse_bad_ply(path: Path) -> None:
    """Raise where the header promises more elements than the file has bytes, or than it has lines of text."""
    with open(path, "rb") as file:
        head = file.read(HEADER_BYTES)
    end = head.find(b"end_header")
    if not head.startswith(b"ply") or end < 0:
        raise InputError("cannot be read as .ply; is it damaged?", path=path)
    most = path.stat().st_size
    if re.search(rb"^format +ascii", head[:end], re.MULTILINE):
        most = _lines(path) - head[:end].count(b"\n")
    for name, count in ELEMENT.findall(head[:end]):
        if not 0 <= int(count[:20]) <= most:
            what = f"says that it holds {int(count[:20])} of '{name[:20].decode('ascii', 'replace')}'"
            raise InputError(f"{what}, which do not fit in it; is it cut off?", path=path)


def _lines(path: Path) -> int:
    """Lines of text, a last one without its end included."""
    count = 1
    with open(path, "rb") as file:
        while chunk := file.read(CHUNK):
            count += chunk.count(b"\n")
    return count
