"""Pictures in files: OpenEXR in and out, PNG previews.

OpenEXR's Python module ignores numpy strides, and returns a file without parts for truncated input; hence
contiguous copies on the way out, and a check of what was written.
"""

from __future__ import annotations

import errno
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from weft.files.atomic import atomic_write
from weft.files.errors import InputError


def write_exr(path: str | Path, channels: Mapping[str, np.ndarray], attributes: Mapping[str, object]) -> None:
    """Write float32 channels of one size, shape [height, width], losslessly (ZIP), and read them back.

    Nothing is left behind if it fails.
    """
    import OpenEXR

    arrays = {name: np.ascontiguousarray(data, np.float32) for name, data in channels.items()}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **attributes}
    with atomic_write(path) as temporary:
        with (
            _errors_of_writing(path),
            OpenEXR.File(header, dict(arrays)) as file,
        ):  # it replaces the dict's values
            file.write(str(temporary))
        written, _ = read_exr(temporary)
        for name, data in arrays.items():
            if not np.array_equal(written[name], data, equal_nan=True):
                raise OSError(f"{path}: channel {name} reads back differently from what was written")


def read_exr(path: str | Path) -> tuple[dict[str, np.ndarray], dict[str, object]]:
    """Channels and attributes of a single-part file. Raises `InputError` for what is not one."""
    import OpenEXR

    if not Path(path).is_file():
        raise InputError("no such file.", path=path)
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            if len(file.parts) != 1:
                raise InputError(
                    f"an OpenEXR file with {len(file.parts)} readable parts; 1 is needed.", path=path
                )
            part = file.parts[0]
            channels = {name: np.array(channel.pixels) for name, channel in part.channels.items()}
            return channels, dict(part.header)
    except RuntimeError as error:
        raise InputError(f"not a readable OpenEXR file: {error}.", path=path) from error


@dataclass(frozen=True)
class ExrPart:
    """One of several pictures in a file; channels float32 or uint32, shape [height, width]."""

    name: str
    channels: Mapping[str, np.ndarray]
    attributes: Mapping[str, object]
    corner: tuple[int, int] = (0, 0)
    """Left and top [pixels]."""


def write_parts(path: Path, parts: Sequence[ExrPart]) -> None:
    """Write several parts, uncompressed. Not atomic, and not read back: the caller does both."""
    import OpenEXR

    heights = [next(iter(part.channels.values())).shape for part in parts]
    width = max(part.corner[0] + shape[1] for part, shape in zip(parts, heights, strict=True))
    height = max(part.corner[1] + shape[0] for part, shape in zip(parts, heights, strict=True))
    display = _box((0, 0), (height, width))
    written = []
    for part, shape in zip(parts, heights, strict=True):
        header = {
            "compression": OpenEXR.NO_COMPRESSION,
            "type": OpenEXR.scanlineimage,
            "dataWindow": _box(part.corner, shape),
            "displayWindow": display,
            **part.attributes,
        }
        channels = {name: np.ascontiguousarray(data) for name, data in part.channels.items()}
        written.append(OpenEXR.Part(header, channels, part.name))
    with _errors_of_writing(path), OpenEXR.File(written) as file:
        file.write(str(path))


def read_parts(path: str | Path, *, header_only: bool = False) -> dict[str, ExrPart]:
    """The parts of a file by name. Raises `InputError` for what is not one."""
    import OpenEXR

    try:
        with OpenEXR.File(str(path), separate_channels=True, header_only=header_only) as file:
            if not file.parts:
                raise InputError("an OpenEXR file without readable parts.", path=path)
            return {part.name(): _part(part) for part in file.parts}
    except RuntimeError as error:
        raise InputError(f"not a readable OpenEXR file: {error}.", path=path) from error


def _part(part: Any) -> ExrPart:
    left, top = part.header["dataWindow"][0]
    channels = {name: channel.pixels for name, channel in part.channels.items()}
    return ExrPart(part.name(), channels, dict(part.header), (int(left), int(top)))


def _box(corner: tuple[int, int], shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    low = np.array(corner, np.int32)
    return low, low + np.array([shape[1] - 1, shape[0] - 1], np.int32)


@contextmanager
def _errors_of_writing(path: str | Path) -> Iterator[None]:
    """OpenEXR has no error numbers; a full disk has its own exit code."""
    try:
        yield
    except RuntimeError as error:
        full = any(reason in str(error) for reason in ("No space left", "File too large", "quota exceeded"))
        number = errno.ENOSPC if full else errno.EIO
        raise OSError(number, f"OpenEXR could not write {path}: {error}") from error


def read_rgb(path: str | Path) -> np.ndarray:
    """Channels R, G, B as float32, shape [height, width, 3]."""
    channels, _ = read_exr(path)
    if missing := [name for name in "RGB" if name not in channels]:
        raise InputError(f"no channel {', '.join(missing)}; found {', '.join(sorted(channels))}.", path=path)
    return np.stack([channels[name] for name in "RGB"], axis=-1).astype(np.float32)


def write_preview(path: str | Path, radiance: np.ndarray, *, exposure: float = 0.0) -> None:
    """An 8-bit sRGB PNG of linear radiance, shape [height, width, 3], brightened by `exposure` stops."""
    from PIL import Image

    levels = np.rint(srgb(radiance * 2.0**exposure) * 255).astype(np.uint8)
    with atomic_write(path) as temporary:
        Image.fromarray(levels, "RGB").save(temporary, format="PNG")


def srgb(linear: np.ndarray) -> np.ndarray:
    """sRGB transfer function (IEC 61966-2-1), clipped to [0, 1]."""
    x = np.clip(np.nan_to_num(linear), 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
