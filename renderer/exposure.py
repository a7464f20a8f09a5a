"""Taking the samples of a picture: which come next, when to keep what is done, and when to stop.

A pass takes a few blocks of samples of a tile of the picture. Between two dispatches all of its state is
known, so a run may be stopped there, and goes on from there with the same bits.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .blocks import TileSums, Window, planned_windows
from .checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from .config import RenderConfig
from .film import Film
from .identity import refuse_other_identity
from .kernel import Counts, Kernel
from .passes import Pass, PassState
from .progress import Progress, ProgressReport, Watch
from .scene import Scene

PIXELS_PER_PASS = 1 << 20
TRIAL_SAMPLES = 8
"""Samples per pixel by which `noise` and `time_s` decide how many are taken."""
FIRST_TRIAL_SAMPLE = 1 << 24
"""Behind all samples that a picture can have."""


@dataclass(frozen=True)
class Keeping:
    """Where a run keeps what it has done."""

    path: Path
    """Of the checkpoint."""
    every_s: float = 60.0
    """Time between checkpoints. A run shorter than that writes none, unless it is stopped."""
    resume: bool = False
    """Whether to go on from the checkpoint that is there."""


@dataclass(frozen=True)
class Share:
    """A part of the samples of a picture: some blocks of some tiles."""

    blocks: range | None = None
    """Unset: all that the picture asks for."""
    windows: tuple[Window, ...] | None = None
    """Unset: the whole picture."""


WHOLE = Share()


def never() -> bool:
    """Nobody asks to stop."""
    return False


class Exposure:
    """The samples taken so far, and how to take the others."""

    def __init__(
        self,
        kernel: Kernel,
        scene: Scene,
        *,
        identity: Mapping[str, Any] | None = None,
        origin: Mapping[str, object] | None = None,
        keeping: Keeping | None = None,
        share: Share = WHOLE,
        stop: Callable[[], bool] = never,
        progress: Progress | None = None,
        watch: Watch | None = None,
    ) -> None:
        self.kernel, self.scene, self.config = kernel, scene, scene.config
        self.origin = dict(origin or {})
        self.identity, self.keeping, self.share = dict(identity or {}), keeping, share
        self.stop, self.progress, self.watch = stop, progress, watch
        self.first = 0 if share.blocks is None else share.blocks.start * self.config.block_samples
        self.last = self.first
        self.tiles = [self._empty_tile(window) for window in self._windows()]
        self.begun: PassState | None = None
        self.counts_before = Counts()
        self.kept_at = self.started = time.monotonic()
        self.written = False

    def run(self) -> bool:
        """Take all samples; false where it was stopped before."""
        previous = self._previous()
        self.last = self._last_sample(previous)
        total = self._missing() + self._taken()
        self.report = ProgressReport(
            self.progress, total, self._taken(), watch=self.watch, film=self._film_in_passing
        )
        while not self.stop() and (work := self._next_pass()) is not None:
            self._begin(work)
            if not self._finish_pass():
                break
        complete = self._next_pass() is None
        self._keep_at_the_end(complete)
        return complete

    def film(self) -> Film:
        """The picture so far."""
        left, top, width, height = self.config.window
        film = Film.empty(
            width, height, layers=self.scene.film_layers, filtered=self.config.filter.kind != "box"
        )
        film.samples = np.zeros(width * height, np.int64)
        places = np.arange(width * height).reshape(height, width)
        for tile in self.tiles:
            x, y, w, h = tile.window
            here = places[y - top : y - top + h, x - left : x - left + w].ravel()
            begun = self.begun
            mine = begun if begun is not None and begun.work.window == tile.window else None
            film.sums[:, here], film.samples[here] = tile.total(mine)
        return film

    def _film_in_passing(self) -> Film:
        """The picture so far, between two dispatches."""
        self.begun = self.kernel.state()
        try:
            return self.film()
        finally:
            self.begun = None

    def _windows(self) -> list[Window]:
        width = self.config.window[2]
        room = self.kernel.film_bytes // (self.scene.film_layers * 16)
        rows = self.kernel.options.rows_per_pass or max(1, min(PIXELS_PER_PASS, room) // width)
        wished = self.share.windows or planned_windows(self.config.window, rows)
        return list(wished)

    def _empty_tile(self, window: Window) -> TileSums:
        return TileSums(window, self.scene.film_layers, self.config.block_samples, begin=self.first)

    def _previous(self) -> Checkpoint | None:
        """The checkpoint to go on from, its sums taken over."""
        if self.keeping is None or not self.keeping.resume or not self.keeping.path.is_file():
            return None
        checkpoint = read_checkpoint(self.keeping.path)
        refuse_other_identity(checkpoint.identity, self.identity, self.keeping.path, "this run")
        self._take_over(checkpoint)
        self.written = True
        return checkpoint

    def _take_over(self, checkpoint: Checkpoint) -> None:
        """The tiles of a checkpoint of the same part, though the device's pool would now have others."""
        tiles = {tile.window: tile for tile in self.tiles}
        if checkpoint.notes["part"] == self._part():
            windows: list[Window] = [tuple(window) for window in checkpoint.notes["tiles"]]
            tiles = {window: self._empty_tile(window) for window in windows}
        for unit in checkpoint.units:
            if unit.window in tiles:
                tiles[unit.window].put_back(unit)
        self.tiles = list(tiles.values())
        counted = "counts_before"
        if checkpoint.begun is not None and checkpoint.begun.work.window in tiles:
            self.begun, counted = checkpoint.begun, "counts"
        self.counts_before = Counts(**checkpoint.notes["counts_before"])
        self.kernel.counts = Counts(**checkpoint.notes[counted])

    def _part(self) -> list[list[int]]:
        """The part of the picture that is wished for."""
        return [list(window) for window in self.share.windows or [self.config.window]]

    def _last_sample(self, previous: Checkpoint | None) -> int:
        """The end of the samples wished for."""
        most = self.config.samples_per_pixel
        if self.share.blocks is not None:
            return min(self.share.blocks.stop * self.config.block_samples, most)
        if previous is not None and previous.notes["asked"] == self._asked():
            return int(previous.notes["last"])
        return self._planned_samples()

    def _asked(self) -> dict[str, Any]:
        return {name: getattr(self.config, name) for name in ("samples_per_pixel", "noise", "time_s")}

    def _planned_samples(self) -> int:
        """Samples per pixel; `noise` and `time_s` decide by a trial whose samples are not in the picture.

        A number that depended on the samples it counts would bias their mean.
        """
        most = self.config.samples_per_pixel
        if (self.config.noise is None and self.config.time_s is None) or most <= TRIAL_SAMPLES:
            return most
        started = time.perf_counter()
        trial = Film.empty(*self.config.window[2:], layers=self.scene.film_layers)
        trial.samples = TRIAL_SAMPLES
        samples = range(FIRST_TRIAL_SAMPLE, FIRST_TRIAL_SAMPLE + TRIAL_SAMPLES)
        first = 0
        for tile in self.tiles:
            trial.sums[:, first : first + tile.pixel_count] = self.kernel.trace(Pass(tile.window, samples))[0]
            first += tile.pixel_count
        return samples_needed(self.config, trial, time.perf_counter() - started)

    def _next_pass(self) -> Pass | None:
        """The blocks that come next: of the tile that has the fewest samples."""
        if self.begun is not None and self.begun.work.samples.stop <= self.last:
            return self.begun.work
        tile = min(self.tiles, key=lambda tile: tile.until)
        if tile.until >= self.last:
            return None
        size = self.config.block_samples
        room = self.kernel.film_bytes // (self.scene.film_layers * 16 * tile.pixel_count)
        blocks = self.kernel.options.blocks_per_pass or max(1, room)
        return Pass(tile.window, range(tile.until, min((tile.until // size + blocks) * size, self.last)))

    def _begin(self, work: Pass) -> None:
        """Start the pass, or go on with it where the state of its paths was kept."""
        if self.begun is not None and self.begun.work == work and self.kernel.restore(self.begun):
            self.begun = None
            return
        if self.begun is not None:
            self.kernel.counts, self.begun = self.counts_before, None
        self.counts_before = Counts(**asdict(self.kernel.counts))
        self.kernel.begin(work, self._tile(work).begun)

    def _tile(self, work: Pass) -> TileSums:
        return next(tile for tile in self.tiles if tile.window == work.window)

    def _finish_pass(self) -> bool:
        """Dispatch by dispatch; false where it was stopped, the state then kept in `begun`."""
        while self.kernel.busy:
            self.report.add(self.kernel.advance())
            if self.kernel.busy and self.stop():
                self.begun = self.kernel.state()
                return False
            if self.kernel.busy and self._due():
                self._keep(self.kernel.state())
        work = self.kernel.work
        self._tile(work).add(work.samples, self.kernel.sums())
        if self._due():
            self._keep(None)
        return True

    def _due(self) -> bool:
        return self.keeping is not None and time.monotonic() - self.kept_at >= self.keeping.every_s

    def _keep_at_the_end(self, complete: bool) -> None:
        if self.keeping is None:
            return
        short = time.monotonic() - self.started < self.keeping.every_s
        if complete and short and not self.written and self.share == WHOLE:
            self.keeping.path.unlink(missing_ok=True)  # of another run
        elif self._taken() or self.begun is not None:
            self._keep(self.begun)

    def _keep(self, begun: PassState | None) -> None:
        assert self.keeping is not None
        notes = {
            "asked": self._asked(),
            "last": self.last,
            "part": self._part(),
            "picture": {
                "origin": dict(self.origin),
                "film_layers": self.scene.film_layers,
                "filtered": self.config.filter.kind != "box",
                "voxel_size_mm": self.scene.pool.voxel_size_mm,
                "exposure": self.config.exposure,
            },
            "tiles": [tile.window for tile in self.tiles],
            "counts": asdict(self.kernel.counts),
            "counts_before": asdict(self.counts_before if begun is not None else self.kernel.counts),
        }
        units = tuple(unit for tile in self.tiles for unit in tile.units())
        size = self.config.block_samples
        write_checkpoint(
            self.keeping.path, Checkpoint(self.identity, self.config.window, size, units, begun, notes)
        )
        self.kept_at, self.written = time.monotonic(), True

    def _taken(self) -> int:
        return sum((tile.until - tile.begin) * tile.pixel_count for tile in self.tiles)

    def _missing(self) -> int:
        return sum(max(self.last - tile.until, 0) * tile.pixel_count for tile in self.tiles)


def samples_needed(config: RenderConfig, trial: Film, seconds: float) -> int:
    """The fewer of what `noise` and `time_s` ask for per pixel, by a trial that took some seconds."""
    wished = [config.samples_per_pixel]
    if config.noise is not None:
        wished.append(math.ceil(trial.fewest_samples * (trial.relative_error() / config.noise) ** 2))
    if config.time_s is not None:
        wished.append(int((config.time_s - seconds) / seconds * trial.fewest_samples))
    return max(min(wished), 2)
