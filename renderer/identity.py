"""What samples are of: all that decides their bits, as flat names, so that a difference can be named."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from weft.files.errors import MergeError

from .config import RenderConfig
from .gpu.shader_source import SHADER_FOLDER
from .scene import Scene

NOT_DECIDING = {"samples_per_pixel", "noise", "time_s", "exposure", "volume", "brick_pool_mb"}
"""Settings of [render] that change no sample, but how many there are, or that are hashed by their content."""


def scene_identity(scene: Scene, volume_sha256: str, device: str) -> dict[str, Any]:
    """Names and JSON values that are equal exactly where samples are of the same picture."""
    exact = scene.config.outside_batch == "park"
    left_out = NOT_DECIDING if exact else NOT_DECIDING - {"brick_pool_mb"}
    return {
        "volume": volume_sha256,
        "scattering": _hash(scene.phase.parameters),
        **({"media": scene.media.content_sha256} if scene.media else {}),
        "lights and surfaces": _hash(scene.tables),
        **_flat(without_folders(scene.config.model_dump(exclude=left_out)), "render"),
        "weft": weft_version(),
        "shaders": shaders_sha256(),
        "device": device,
    }


def picture_origin(config: RenderConfig, device: str) -> dict[str, str]:
    """Attributes of a picture's file that say where it comes from."""
    text = json.dumps(without_folders(config.model_dump()))
    return {
        "weft.version": weft_version(),
        "weft.config": text,
        "weft.configSha256": hashlib.sha256(text.encode()).hexdigest(),
        "weft.window": ", ".join(str(n) for n in config.window),
        "weft.seed": str(config.seed),
        "weft.device": device,
        "weft.extinction": config.extinction,
    }


def refuse_other_identity(
    found: Mapping[str, Any], wished: Mapping[str, Any], path: str | Path, other: str | Path
) -> None:
    """Raises `MergeError` that names the first field which differs."""
    for name in {**wished, **found}:
        here, there = found.get(name), wished.get(name)
        if here != there:
            more = [key for key in {**wished, **found} if found.get(key) != wished.get(key)]
            also = f" ({len(more) - 1} more differ)" if len(more) > 1 else ""
            what = f"{name}: {_shown(here)} here, {_shown(there)} in {other}{also}."
            raise MergeError(what, path=path, hint="Only samples of the same picture belong together.")


def without_folders(value: object) -> Any:
    """Settings as JSON holds them, files by their names alone: a picture tells nothing about the machine."""
    if isinstance(value, Path):
        return value.name
    if isinstance(value, BaseModel):
        return without_folders(value.model_dump())
    if isinstance(value, Mapping):
        return {str(key): without_folders(part) for key, part in value.items()}
    return [without_folders(part) for part in value] if isinstance(value, list | tuple) else value


def weft_version() -> str:
    """Of the installed package."""
    try:
        return version("weft")
    except PackageNotFoundError:
        return "unknown"


@cache
def shaders_sha256() -> str:
    """Of all text under renderer/shaders/."""
    digest = hashlib.sha256()
    for file in sorted(SHADER_FOLDER.rglob("*")):
        if file.suffix in {".glsl", ".comp"}:
            content = file.read_bytes()
            digest.update(f"{file.relative_to(SHADER_FOLDER)} {len(content)}\n".encode() + content)
    return digest.hexdigest()


def _hash(array: np.ndarray) -> str:
    return hashlib.sha256(np.ascontiguousarray(array).data).hexdigest()


def _flat(value: Any, name: str) -> dict[str, Any]:
    if isinstance(value, dict):
        return {key: part for k, v in value.items() for key, part in _flat(v, f"{name}.{k}").items()}
    if isinstance(value, list) and any(isinstance(part, dict | list) for part in value):
        return _flat({str(i): part for i, part in enumerate(value)}, name)
    return {name: json.loads(json.dumps(value))}


def _shown(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else text[:14] + "…" + text[-4:]
