"""Which reader looks into a file, what the record beside it says, and the lines that are printed."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from weft.files.errors import InputError
from weft.pipeline.cache import stamp_of
from weft.pipeline.messages import did_you_mean
from weft.pipeline.run_record import parse_record, read_record

from .facts import Facts
from .measurement_files import measurement_facts
from .volume_files import exr_facts, png_facts, volume_facts
from .yarn_files import (
    arrays_facts,
    bcc_facts,
    bccx_facts,
    hair_facts,
    obj_facts,
    poly_facts,
    pyp_facts,
    smobj_yarns_facts,
    usd_facts,
)


def describe(path: Path, *, verify: bool = False, as_json: bool = False) -> list[str]:
    """Lines for people, or one JSON object. Raises `InputError` for what cannot be read or has changed."""
    try:
        there = path.is_file()
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", path=path) from error
    if not there:
        raise InputError("is a folder; give a file" if path.is_dir() else "no such file", path=path)
    reader = READERS.get(_kind(path))
    if reader is None:
        what = f"weft cannot look into '{path.suffix}' files"
        raise InputError(what + did_you_mean(path.suffix, READERS), path=path)
    facts = {"file": str(path), "bytes": path.stat().st_size, **reader(path)}
    facts |= _against_record(path, verify=verify)
    if verify:
        facts |= _verified(path, facts)
    return [json.dumps(facts, default=str)] if as_json else _lines(facts)


def _kind(path: Path) -> str:
    return ".run.json" if path.name.endswith(".run.json") else path.suffix.lower()


def _lines(facts: Mapping[str, Any], indent: str = "") -> list[str]:
    width = max((len(name) for name in facts), default=0) + 2
    lines = []
    for name, value in facts.items():
        if isinstance(value, Mapping):
            lines += [f"{indent}{name}", *_lines(value, indent + "  ")]
        else:
            lines.append(f"{indent}{name:<{width}}{_text(value)}")
    return lines


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, (list, tuple)):
        return ", ".join(_text(item) for item in value)
    return str(value)


def _against_record(path: Path, *, verify: bool) -> Facts:
    """What the run record beside a result says of it."""
    for file in sorted(path.parent.glob("*.run.json")):
        record = read_record(file)
        stamps = record.outputs.values() if record else ()
        stamp = next((stamp for stamp in stamps if stamp.path == path.name), None)
        if record and stamp:
            facts = {
                "made by": f"{record.written_by}, stage {record.stage}, {record.started}",
                "record": file.name,
            }
            if verify and stamp_of(path).sha256 != stamp.sha256:
                raise InputError(f"differs from what {file.name} says was written", path=path)
            return facts | ({"verified": f"content is as {file.name} says"} if verify else {})
    return {}


def _verified(path: Path, facts: Facts) -> Facts:
    """A check by the hash that the file itself carries, or the record beside it."""
    if "content hash" in facts:
        if path.suffix == ".vdb":
            from weft.voxelize.vdb import refuse_changed_file

            refuse_changed_file(path)
        return {"verified": "content agrees with the hash in the file"}
    if "verified" not in facts and "outputs" not in facts:
        raise InputError("carries no hash and has no run record beside it to verify against", path=path)
    return {}


def _job(path: Path) -> Facts:
    from weft.pipeline.cache import flattened
    from weft.pipeline.config import load

    job = load(path)
    names = [name for name in type(job.config).model_fields if job.has(name) and name != "include"]
    resolved = {name: flattened(getattr(job.config, name), ()) for name in names}
    return {
        "content": "job",
        "results in": str(job.output),
        **{name: keys for name, keys in resolved.items() if keys},
    }


def _record(path: Path) -> Facts:
    record = parse_record(path)
    facts = {
        "content": "run record",
        "stage": record.stage,
        "made by": record.written_by,
        "started": record.started,
        "seconds": record.seconds,
        "command": " ".join(record.command),
        "report": record.report,
        "seeds": record.seeds,
        "versions": record.versions,
        "machine": record.machine,
        "inputs": {name: f"{stamp.path} {stamp.sha256[:12]}" for name, stamp in record.inputs.items()},
    }
    return facts | {"outputs": {stamp.path: _state(path.parent, stamp) for stamp in record.outputs.values()}}


def _state(folder: Path, stamp: Any) -> str:
    file = folder / stamp.path
    if not file.is_file():
        return "is gone"
    return "unchanged" if stamp_of(file).sha256 == stamp.sha256 else "was changed since"


def _scattering(path: Path) -> Facts:
    from dataclasses import asdict

    from weft.pipeline.scattering_file import read_scattering

    return {
        "content": "scattering parameters",
        **{name: asdict(p) for name, p in read_scattering(path).items()},
    }


READERS: dict[str, Callable[[Path], Facts]] = {
    ".npz": arrays_facts,
    ".bcc": bcc_facts,
    ".bccx": bccx_facts,
    ".hair": hair_facts,
    ".mitshair": hair_facts,
    ".poly": poly_facts,
    ".yarns": smobj_yarns_facts,
    ".usd": usd_facts,
    ".usda": usd_facts,
    ".usdc": usd_facts,
    ".pyp": pyp_facts,
    ".obj": obj_facts,
    ".vdb": volume_facts,
    ".nvdb": volume_facts,
    ".csv": measurement_facts,
    ".alta": measurement_facts,
    ".bsdf": measurement_facts,
    ".binary": measurement_facts,
    ".bin": measurement_facts,
    ".exr": exr_facts,
    ".png": png_facts,
    ".toml": _job,
    ".run.json": _record,
    ".json": _scattering,
}
