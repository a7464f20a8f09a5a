"""Joining shares of a picture, in any order, to the bits that one run would have made.

Blocks are folded as one run folds them: pixel by pixel in ascending order of their samples, in float64.
Whatever does not belong together, is there twice or is missing is refused with the name of what differs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from weft.files.errors import InputError, MergeError

from .blocks import Unit, Window
from .checkpoint import read_checkpoint, read_header
from .film import Film
from .identity import refuse_other_identity
from .image import write_exr, write_preview


@dataclass(frozen=True)
class _Piece:
    """A unit of a share, not yet read."""

    samples: range
    window: Window
    path: Path
    number: int


@dataclass(frozen=True)
class MergedPicture:
    """The picture of all shares."""

    film: Film
    notes: Mapping[str, Any]
    complete: bool

    def save(self, path: str | Path) -> None:
        """As a run saves it: .exr and .png."""
        path, picture = Path(path), self.notes["picture"]
        layers = self.film.layers(picture["voxel_size_mm"])
        attributes = picture["origin"] | {
            "weft.samplesPerPixel": self.film.fewest_samples,
            "weft.complete": int(self.complete),
            "weft.cutPaths": str(int(layers["cut"].sum())),
        }
        write_exr(path, layers, attributes)
        radiance = np.stack([layers[name] for name in "RGB"], axis=-1)
        write_preview(path.with_suffix(".png"), radiance, exposure=picture["exposure"])


def merge_shares(paths: Sequence[str | Path], *, partial: bool = False) -> MergedPicture:
    """The picture of some shares. `partial`: also where samples are missing.

    Raises `MergeError` for shares of different pictures, for samples that are there twice or missing, and for
    damaged files.
    """
    if not paths:
        raise InputError("merge: no shares are given.")
    headers = {Path(path): read_header(path) for path in paths}
    first, reference = next(iter(headers.items()))
    for path, header in headers.items():
        refuse_other_identity(header["identity"], reference["identity"], path, first)
        _refuse_other("window", path, header, first, reference)
        _refuse_other("block_samples", path, header, first, reference)
    pieces = sorted(_pieces(headers), key=lambda piece: (piece.samples.start, piece.path.name))
    wished = max(int(header["notes"]["last"]) for header in headers.values())
    asked = [header["notes"]["asked"] for header in headers.values()]
    if all(one["noise"] is None and one["time_s"] is None for one in asked):
        wished = max(wished, *(int(one["samples_per_pixel"]) for one in asked))
    film = _fold(pieces, reference)
    complete = bool(np.all(film.samples == wished))
    if not complete and not partial:
        raise _hole(film, reference["window"], wished)
    return MergedPicture(film, reference["notes"], complete)


def _refuse_other(
    name: str, path: Path, header: Mapping[str, Any], first: Path, reference: Mapping[str, Any]
) -> None:
    if header[name] != reference[name]:
        raise MergeError(f"{name}: {header[name]} here, {reference[name]} in {first}.", path=path)


def _pieces(headers: Mapping[Path, Mapping[str, Any]]) -> list[_Piece]:
    return [
        _Piece(range(*unit["samples"]), tuple(unit["window"]), path, number)
        for path, header in headers.items()
        for number, unit in enumerate(header["units"])
    ]


def _fold(pieces: Sequence[_Piece], reference: Mapping[str, Any]) -> Film:
    """All pieces in ascending order. One file at a time is in memory."""
    left, top, width, height = reference["window"]
    picture = reference["notes"]["picture"]
    film = Film.empty(width, height, layers=picture["film_layers"], filtered=picture["filtered"])
    samples = film.samples = np.zeros(width * height, np.int64)
    places = np.arange(width * height).reshape(height, width)
    open_path: Path | None = None
    units: tuple[Unit, ...] = ()
    for piece in pieces:
        x, y, w, h = piece.window
        here = places[y - top : y - top + h, x - left : x - left + w].ravel()
        _refuse_overlap_or_hole(samples[here], piece)
        if piece.path != open_path:
            open_path, units = piece.path, read_checkpoint(piece.path).units
        film.sums[:, here] += units[piece.number].sums
        samples[here] = piece.samples.stop
    return film


def _refuse_overlap_or_hole(done: np.ndarray, piece: _Piece) -> None:
    x, y, w, h = piece.window
    part = f"of the {w} x {h} pixels from ({x}, {y})"
    if (done > piece.samples.start).any():
        what = f"samples: {piece.samples.start} to {piece.samples.stop} {part} are in another share too."
        raise MergeError(what, path=piece.path, hint="Give every share once.")
    if (done < piece.samples.start).any():
        raise _missing(int(done.min()), piece.samples.start, part)


def _hole(film: Film, window: Sequence[int], wished: int) -> MergeError:
    samples = np.broadcast_to(film.samples, film.sums.shape[1])
    places = np.flatnonzero(samples != wished)
    place = int(places[0])
    y, x = divmod(place, film.width)
    part = f"of {len(places)} pixels, the first of them ({x + window[0]}, {y + window[1]}),"
    return _missing(int(samples[place]), wished, part)


def _missing(start: int, stop: int, part: str) -> MergeError:
    return MergeError(
        f"merge: samples: {start} to {stop} {part} are in no share.",
        hint="Render the missing share, or finish a stopped one with --resume.",
    )
