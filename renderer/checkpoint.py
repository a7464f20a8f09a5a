"""Checkpoints: what a run has summed so far, in a file that resumes it or is merged with others.

An OpenEXR file, uncompressed, with a part for each block of samples (float32, channels named after the film's
layers, dataWindow where it lies in the picture), one for all blocks that are folded already (float64, as two
uint32 channels each), and one for the paths that were under way, or where voxels are out of core a few
(`aside ...`, passes.Aside), whose words fill an image. Attribute `weft.checkpoint` of the first
part is a JSON object: schema, what the samples are of (`identity`), and what each part holds. Behind the
OpenEXR data, where readers do not look, follow the ASCII word weftsha2 and the SHA-256 of all bytes before
it, so that a damaged file is refused before anything in it is read.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from weft.files.atomic import atomic_write
from weft.files.errors import InputError, MergeError

from .blocks import Unit
from .image import ExrPart, read_parts, write_parts
from .passes import Aside, Pass, PassState

SCHEMA = 1
ATTRIBUTE = "weft.checkpoint"
SEAL = b"weftsha2"
SEAL_BYTES = len(SEAL) + hashlib.sha256().digest_size
CHUNK = 1 << 22
ASIDE_NUMBERS = ("capacity", "strip", "first_sample", "last_sample")
IMAGE_WIDTH = 1024
"""Of the parts that are no images."""
FILM_ROWS = ("R,G,B,hits", "squares.R,squares.G,squares.B,Z", "xx,yy,xy,xz", "albedo.R,albedo.G,albedo.B,yz")
"""Channels of the film's first layers, in the order of shaders/film/film.glsl."""
MORE_ROWS = ("weighted,cut,surfaces,unused", "N.X,N.Y,N.Z,unused2")


@dataclass(frozen=True)
class Checkpoint:
    """What a run has summed so far."""

    identity: Mapping[str, Any]
    """What the samples are of, as flat names and JSON values. Only samples of the same are ever added."""
    window: tuple[int, int, int, int]
    """The whole picture: left, top, width and height [pixels]."""
    block_samples: int
    units: tuple[Unit, ...]
    begun: PassState | None = None
    """The pass that was under way."""
    notes: Mapping[str, Any] = field(default_factory=dict)
    """What resuming needs besides: samples wished for, counts so far."""


def write_checkpoint(path: str | Path, checkpoint: Checkpoint) -> None:
    """Write, flush and read back, then put in the place of the previous one.

    Raises `DiskSpaceError` where the disk is full; the previous one is then as it was.
    """
    with atomic_write(path) as temporary:
        write_parts(temporary, list(_parts(checkpoint)))
        _seal(temporary)
        _compare(checkpoint, read_checkpoint(temporary), path)


def read_checkpoint(path: str | Path) -> Checkpoint:
    """Raises `InputError` where there is none, and `MergeError` where it is damaged."""
    header = read_header(path)
    parts = read_parts(path)
    units = [_unit(entry, parts[entry["part"]]) for entry in header["units"]]
    begun = header["pass"]
    return Checkpoint(
        identity=header["identity"],
        window=_window(header["window"]),
        block_samples=header["block_samples"],
        units=tuple(unit for unit in units if unit.samples),
        begun=None if begun is None else _pass_state(begun, parts),
        notes=header["notes"],
    )


def read_header(path: str | Path) -> dict[str, Any]:
    """What the file says of itself, once its seal is found unbroken; no pixels."""
    check_seal(path)
    text = read_parts(path, header_only=True)["units"].attributes.get(ATTRIBUTE)
    header = json.loads(text) if isinstance(text, str) else {}
    if header.get("schema") != SCHEMA:
        found = header.get("schema", "no checkpoint")
        raise MergeError(f"schema: {found} here, {SCHEMA} is what this version reads.", path=path)
    return dict(header)


def check_seal(path: str | Path) -> None:
    """Raises `MergeError` unless the file ends with the hash of what is before it."""
    path = Path(path)
    if not path.is_file():
        raise InputError("no such file.", path=path)
    with open(path, "rb") as file:
        left = path.stat().st_size - SEAL_BYTES
        digest = hashlib.sha256()
        while left > 0 and (chunk := file.read(min(CHUNK, left))):
            digest.update(chunk)
            left -= len(chunk)
        seal = file.read()
    if not seal.startswith(SEAL) or len(seal) != SEAL_BYTES:
        raise MergeError("no checkpoint, or a truncated one: its end is missing.", path=path)
    if seal != SEAL + digest.digest():
        raise MergeError("damaged: its bytes do not agree with the sha256 at its end.", path=path)


def _seal(path: Path) -> None:
    digest = hashlib.sha256()
    with open(path, "rb+") as file:
        while chunk := file.read(CHUNK):
            digest.update(chunk)
        file.write(SEAL + digest.digest())


def _parts(checkpoint: Checkpoint) -> Iterator[ExrPart]:
    """The first is an empty one for the header, so that it is found under one name."""
    units, states = [], []
    for number, unit in enumerate(checkpoint.units):
        name = f"{'folded' if unit.folded else 'block'} {number:05d}"
        units.append(
            {"part": name, "window": unit.window, "samples": [unit.samples.start, unit.samples.stop]}
        )
        states.append(ExrPart(name, _unit_channels(unit), {}, unit.window[:2]))
    begun = checkpoint.begun
    if begun is not None:
        for number, sums in enumerate(begun.sums):
            block = Unit(begun.work.window, begun.work.samples, sums)
            states.append(ExrPart(f"begun {number:05d}", _unit_channels(block), {}, begun.work.window[:2]))
        if begun.aside is None:
            states.append(ExrPart("paths", _columns("w", begun.lanes), {}, (0, 0)))
        else:
            arrays = _aside_arrays(begun, begun.aside)
            states += [ExrPart(f"aside {name}", _words(array), {}, (0, 0)) for name, array in arrays.items()]
    header = {
        "schema": SCHEMA,
        "identity": dict(checkpoint.identity),
        "window": checkpoint.window,
        "block_samples": checkpoint.block_samples,
        "units": units,
        "pass": None if begun is None else _pass_header(begun),
        "notes": dict(checkpoint.notes),
    }
    attribute = {ATTRIBUTE: json.dumps(header)}
    yield ExrPart("units", {"Y": np.zeros((1, 1), np.float32)}, attribute, (0, 0))
    yield from states


def _pass_header(begun: PassState) -> dict[str, Any]:
    samples = begun.work.samples
    return {
        "window": begun.work.window,
        "samples": [samples.start, samples.stop],
        "blocks": len(begun.sums),
        "taken": begun.taken,
        "image_width": begun.image_width,
        "aside": None if begun.aside is None else _aside_header(begun, begun.aside),
    }


def _aside_arrays(begun: PassState, aside: Aside) -> dict[str, np.ndarray]:
    return {
        "lanes": begun.lanes,
        "film": aside.film,
        "next": aside.next,
        "loose": aside.loose,
        "loose_film": aside.loose_film,
    }


def _aside_header(begun: PassState, aside: Aside) -> dict[str, Any]:
    arrays = _aside_arrays(begun, aside)
    return {
        **{name: getattr(aside, name) for name in ASIDE_NUMBERS},
        "arrays": {name: [array.dtype.str, array.shape] for name, array in arrays.items()},
    }


def _words(array: np.ndarray) -> dict[str, np.ndarray]:
    """Any array as an image of uint32, filled up with zeros."""
    words = np.ascontiguousarray(array).reshape(-1).view(np.uint32)
    image = np.zeros((max(-(-len(words) // IMAGE_WIDTH), 1), IMAGE_WIDTH), np.uint32)
    image.reshape(-1)[: len(words)] = words
    return {"words": image}


def _from_words(part: ExrPart, dtype: str, shape: list[int]) -> np.ndarray:
    """The inverse."""
    count = math.prod(shape) * np.dtype(dtype).itemsize // 4
    words = np.ascontiguousarray(part.channels["words"]).reshape(-1)[:count]
    return words.view(dtype).reshape(shape)


def _pass_state(header: Mapping[str, Any], parts: Mapping[str, ExrPart]) -> PassState:
    work = Pass(_window(header["window"]), range(*header["samples"]))
    sums = [
        _sums(parts[f"begun {number:05d}"], work.window, folded=False) for number in range(header["blocks"])
    ]
    state = PassState(work, np.stack(sums), np.zeros(0), header["taken"], header["image_width"])
    if header.get("aside") is not None:
        return _with_aside(state, header["aside"], parts)
    lanes = parts["paths"].channels
    return replace(state, lanes=np.stack([lanes[f"w{column}"] for column in range(4)], axis=-1))


def _with_aside(state: PassState, header: Mapping[str, Any], parts: Mapping[str, ExrPart]) -> PassState:
    arrays = {
        name: _from_words(parts[f"aside {name}"], dtype, shape)
        for name, (dtype, shape) in header["arrays"].items()
    }
    lanes = arrays.pop("lanes")
    values: dict[str, Any] = {name: header[name] for name in ASIDE_NUMBERS} | arrays
    aside = Aside(**values)
    return replace(state, lanes=lanes, aside=aside)


def _columns(prefix: str, lanes: np.ndarray) -> dict[str, np.ndarray]:
    return {f"{prefix}{column}": lanes[..., column] for column in range(lanes.shape[-1])}


def channel_names(layer_count: int) -> list[str]:
    """Of the film's sums, four per layer."""
    return ",".join([*FILM_ROWS, *MORE_ROWS][:layer_count]).split(",")


def _unit_channels(unit: Unit) -> dict[str, np.ndarray]:
    _, _, width, height = unit.window
    images = unit.sums.transpose(0, 2, 1).reshape(-1, height, width)
    names = channel_names(len(unit.sums))
    if not unit.folded:
        return dict(zip(names, images, strict=True))
    words = np.ascontiguousarray(images, "<f8").view("<u4")
    return {
        f"{name}.{half}": words[i, :, k::2]
        for i, name in enumerate(names)
        for k, half in enumerate(("low", "high"))
    }


def _unit(entry: Mapping[str, Any], part: ExrPart) -> Unit:
    window = _window(entry["window"])
    return Unit(window, range(*entry["samples"]), _sums(part, window, folded="R.low" in part.channels))


def _sums(part: ExrPart, window: tuple[int, int, int, int], *, folded: bool) -> np.ndarray:
    """float32 or float64, shape [layers, pixels, 4]."""
    _, _, width, height = window
    layer_count = len(part.channels) // (8 if folded else 4)
    images = np.empty((layer_count * 4, height, width), np.float64 if folded else np.float32)
    words = images.view(np.uint32)
    for i, name in enumerate(channel_names(layer_count)):
        if folded:
            words[i, :, 0::2], words[i, :, 1::2] = part.channels[f"{name}.low"], part.channels[f"{name}.high"]
        else:
            images[i] = part.channels[name]
    sums = images.reshape(layer_count, 4, height * width).transpose(0, 2, 1)
    return np.ascontiguousarray(sums)


def _window(values: list[int]) -> tuple[int, int, int, int]:
    left, top, width, height = values
    return left, top, width, height


def _compare(wished: Checkpoint, found: Checkpoint, path: str | Path) -> None:
    same = len(wished.units) == len(found.units) and all(
        (a.window, a.samples) == (b.window, b.samples) and np.array_equal(a.sums, b.sums)
        for a, b in zip(wished.units, found.units, strict=True)
    )
    if wished.begun is not None and found.begun is not None:
        same = same and np.array_equal(wished.begun.lanes, found.begun.lanes)
        same = same and np.array_equal(wished.begun.sums, found.begun.sums)
        same = same and _same_aside(wished.begun, found.begun)
    if not same:
        raise OSError(f"{path}: the checkpoint reads back differently from what was written")


def _same_aside(one: PassState, other: PassState) -> bool:
    if one.aside is None or other.aside is None:
        return one.aside is other.aside
    arrays = [_aside_arrays(state, state.aside) for state in (one, other) if state.aside is not None]
    return all(
        np.array_equal(arrays[0][name].view(np.uint8), arrays[1][name].view(np.uint8)) for name in arrays[0]
    )
