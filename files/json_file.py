"""JSON files of ours, read with a bound on their size and one clear line for what is wrong."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from weft.files.errors import InputError


def read_json(path: Path, *, max_bytes: int, what: str) -> Any:
    """The file's value. Raises `InputError` where it is unreadable, too large for `what`, or not JSON."""
    try:
        if path.stat().st_size > max_bytes:
            raise InputError(f"is too large for {what}", path=path)
        return json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", path=path) from error
    except (ValueError, RecursionError) as error:
        raise InputError("is not valid JSON", path=path) from error
