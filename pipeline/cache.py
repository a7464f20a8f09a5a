"""Is a stage's result fresh? It is while everything that decides it, and the result itself, is unchanged.

The key of a result holds the stage's resolved config (with the content of each file in place of its path),
the content of the earlier stages' results, and the code that makes it. It lies in the run record beside the
result; there is no other cache. Comparing content rather than times or keys of earlier stages means that an
earlier stage which runs again and makes the same file leaves the later ones fresh.
"""

from __future__ import annotations

import functools
import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from weft.fiber_model.yarns.garments.gltf_files import external_files
from weft.files.errors import InputError

from .job import Job
from .run_record import FileStamp, RunRecord, read_record
from .stage import Stage

KEY_VERSION = 1
"""Raise it when the meaning of the key changes."""

PACKAGE = Path(__file__).resolve().parent.parent
CODE_SUFFIXES = {".py", ".glsl", ".comp", ".vert", ".frag", ".cpp", ".h"}
CHUNK = 1 << 20


@dataclass(frozen=True)
class StageKey:
    """All that decides a stage's result, as flat names and JSON values."""

    values: dict[str, Any]
    inputs: dict[str, FileStamp]

    @property
    def digest(self) -> str:
        return hashlib.sha256(json.dumps(self.values, sort_keys=True).encode()).hexdigest()


def stage_key(stage: Stage, job: Job, inputs: Mapping[str, Path]) -> StageKey:
    """Raises `InputError` where a file cannot be read."""
    stamps = {f"input.{name}": stamp_of(path) for name, path in inputs.items()}
    values: dict[str, Any] = {"key version": KEY_VERSION}
    for table in (*stage.tables, *stage.optional_tables):
        if job.has(table):
            for name, value in flattened(job.table(table), (table,)).items():
                if isinstance(value, Path):
                    stamps[name] = stamp_of(value)
                    # the suffix says how the file is read; where it lies does not matter
                    values |= _companions(name, value, stamps)
                    value = f"{value.suffix} sha256:{stamps[name].sha256}"
                values[name] = value
    values |= flattened(stage.other_settings(job), ())
    values |= {name: f"sha256:{stamps[name].sha256}" for name in stamps if name.startswith("input.")}
    values |= {f"code of {part}": code_fingerprint(part) for part in stage.code}
    return StageKey(values, stamps)


def _companions(name: str, path: Path, stamps: dict[str, FileStamp]) -> dict[str, str]:
    """Files that a file reads in its turn: the buffers of a .gltf. Their stamps join `stamps`."""
    found = {}
    if path.suffix.lower() == ".gltf":
        for number, other in enumerate(external_files(path)):
            key = f"{name} buffer {number}"
            stamps[key] = stamp_of(other)
            found[key] = f"sha256:{stamps[key].sha256}"
    return found


def flattened(value: Any, path: tuple[str, ...]) -> dict[str, Any]:
    """A config as `{"render.camera.kind": "perspective", …}`; paths stay `Path`, to be hashed."""
    if isinstance(value, BaseModel):
        fields = {name: getattr(value, name) for name in type(value).model_fields}
        return _flattened_items(fields.items(), path)
    if isinstance(value, Mapping):
        return _flattened_items(value.items(), path)
    if isinstance(value, (list, tuple)):
        if any(isinstance(item, (BaseModel, Mapping, Path, list, tuple)) for item in value):
            return _flattened_items(enumerate(value), path)
        return {".".join(path): list(value)}
    return {".".join(path): value}


def _flattened_items(items: Iterable[tuple[Any, Any]], path: tuple[str, ...]) -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, item in items:
        flat |= flattened(item, (*path, str(name)))
    return flat


def why_stale(stage: Stage, job: Job, key: StageKey) -> str:
    """Why the stage must run, in a few words; empty where its results are fresh."""
    record = read_record(job.output / stage.record_name(job))
    missing = [name for name in stage.outputs(job).values() if not (job.output / name).is_file()]
    if missing:
        return f"{missing[0]} {'does not exist yet' if record is None else 'is gone'}"
    if record is None:
        return "there is no run record beside it"
    if set(record.outputs) != set(stage.outputs(job)):
        return "it now has other files"
    return _changed_key(record, key) or _changed_outputs(record, job)


def _changed_key(record: RunRecord, key: StageKey) -> str:
    before, now = record.key, json.loads(json.dumps(key.values, default=str))
    names = [name for name in {**before, **now} if before.get(name) != now.get(name)]
    if not names:
        return ""
    others = f" (and {len(names) - 1} more)" if len(names) > 1 else ""
    return _change(names[0], before, now) + others


def _change(name: str, before: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    if name not in before:
        return f"{name} is new"
    if name not in now:
        return f"{name} is gone"
    if "sha256:" in str(before[name]) or "sha256:" in str(now[name]):
        return f"{name.removeprefix('input.')} changed"
    old, new = json.dumps(before[name]), json.dumps(now[name])
    return f"{name} changed" + (f" from {old} to {new}" if len(old + new) < 60 else "")


def _changed_outputs(record: RunRecord, job: Job) -> str:
    for stamp in record.outputs.values():
        if stamp_of(job.output / stamp.path).sha256 != stamp.sha256:
            return f"{stamp.path} was changed after it was made"
    return ""


def stamp_of(path: Path) -> FileStamp:
    """Content hash and size. Raises `InputError` where the file cannot be read."""
    try:
        status = path.stat()
        digest = _content_hash(path, status.st_size, status.st_mtime_ns, status.st_ino)
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", path=path) from error
    return FileStamp(str(path), digest, status.st_size)


@functools.lru_cache(maxsize=4096)
def _content_hash(path: Path, size: int, changed_ns: int, inode: int) -> str:
    """Hashed once in a run; size, time and inode tell a file that was written anew meanwhile."""
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        while chunk := file.read(CHUNK):
            digest.update(chunk)
    return digest.hexdigest()


@functools.cache
def code_fingerprint(part: str) -> str:
    """Of the source below a folder of the package, or of one file: `renderer`, `voxelize/grid.py`."""
    root = PACKAGE / part
    files = [root] if root.is_file() else [file for file in root.rglob("*") if file.suffix in CODE_SUFFIXES]
    digest = hashlib.sha256()
    for file in sorted(files):
        content = file.read_bytes()
        digest.update(f"{file.relative_to(PACKAGE)} {len(content)}\n".encode() + content)
    return f"sha256:{digest.hexdigest()}"
