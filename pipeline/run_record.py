"""The run record beside each result: all it takes to make it again, and to see that it is still itself."""

from __future__ import annotations

import functools
import json
import os
import platform
import re
import sys
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any

from weft.files.atomic import atomic_write
from weft.files.errors import InputError
from weft.files.json_file import read_json

FORMAT = "weft run record"
FORMAT_VERSION = 1
MAX_RECORD_BYTES = 16 * 2**20


@dataclass(frozen=True)
class FileStamp:
    """A file as it was when the record was written."""

    path: str
    sha256: str
    bytes: int


@dataclass(frozen=True)
class RunRecord:
    """How one stage's results came to be."""

    stage: str
    key: dict[str, Any]
    """All that decides the result: config, content of the inputs, code. Fresh while it is equal."""
    config: dict[str, Any]
    """The stage's tables of the job, complete with defaults and presets, with full paths."""
    inputs: dict[str, FileStamp]
    outputs: dict[str, FileStamp]
    """Paths are relative to the record's folder."""
    report: dict[str, Any]
    """What the stage says of its work: counts, times, device."""
    seeds: dict[str, Any]
    versions: dict[str, str]
    machine: dict[str, Any]
    command: list[str]
    started: str
    """UTC, ISO 8601."""
    seconds: float
    format: str = FORMAT
    format_version: int = FORMAT_VERSION
    written_by: str = field(default_factory=lambda: f"weft {library_versions(['weft'])['weft']}")


def write_record(path: Path, record: RunRecord) -> None:
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(asdict(record), indent=2, default=str) + "\n", encoding="utf-8")


def read_record(path: Path) -> RunRecord | None:
    """None where there is no record, or none that this version can read."""
    try:
        return parse_record(path)
    except InputError:
        return None


def parse_record(path: Path) -> RunRecord:
    """Raises `InputError` where the file is no run record."""
    values = read_json(path, max_bytes=MAX_RECORD_BYTES, what="a run record")
    if not isinstance(values, dict) or values.get("format") != FORMAT:
        raise InputError("is not a run record", path=path)
    try:
        for files in ("inputs", "outputs"):
            values[files] = {name: FileStamp(**stamp) for name, stamp in values[files].items()}
        return RunRecord(**values)
    except (TypeError, AttributeError, KeyError) as error:
        raise InputError("is a run record of another version of weft", path=path) from error


def library_versions(names: Iterable[str]) -> dict[str, str]:
    """Installed versions, without importing anything."""
    return {name: _version(name) for name in names}


@functools.cache
def _version(name: str) -> str:
    try:
        described = metadata.distribution(name).read_text("METADATA") or ""
        # parsing all of it, with the readme in it, takes twice as long
        found = re.search(r"^Version: *(\S+)", described, re.MULTILINE)
        return found[1] if found else metadata.version(name)
    except metadata.PackageNotFoundError:
        return "not installed"


def versions_for(libraries: Iterable[str]) -> dict[str, str]:
    return {"python": platform.python_version(), **library_versions(["weft", "pydantic", *libraries])}


def machine() -> dict[str, Any]:
    return {
        "system": platform.platform(),
        "processor": _processor_name(),
        "cores": len(os.sched_getaffinity(0)),
        "memory_gib": round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30, 1),
    }


def _processor_name() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def command_line() -> list[str]:
    return [Path(sys.argv[0]).name, *sys.argv[1:]]


def seeds_in(config: Mapping[str, Any]) -> dict[str, Any]:
    """Every key named `seed` of a resolved config, by its dotted name."""
    found = {}
    for name, value in config.items():
        if isinstance(value, Mapping):
            found.update({f"{name}.{key}": seed for key, seed in seeds_in(value).items()})
        elif name == "seed" or name.endswith("_seed"):
            found[name] = value
    return found
