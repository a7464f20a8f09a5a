"""The render stage: a volume and its scattering in, a picture with statistics out."""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

from weft.voxelize.grid import FiberVolume

from .config import RenderConfig
from .film import Film
from .image import write_exr, write_preview
from .kernel import SAMPLES_PER_PASS, Kernel, KernelOptions
from .scene import Scattering, Scene, build_scene

Progress = Callable[[float, str], None]
PROGRESS_SECONDS = 0.25
PIXELS_PER_PASS = 1 << 20
TRIAL_SAMPLES = 8
"""Samples per pixel by which `noise` and `time_s` decide how many more are taken."""


@dataclass(frozen=True)
class RenderStatistics:
    """What a picture cost, and what to distrust in it."""

    paths: int
    samples_per_pixel: int
    """Those in the picture."""
    scattering_events: int
    tracking_steps: int
    cut_paths: int
    """Paths ended by `max_bounces`: where this is not small, the picture is too dark."""
    broken_samples: int
    """Samples that came out not finite and count as black; 0 unless something is wrong."""
    majorant_violations: int
    """Places denser than their bound, with delta tracking; 0 unless something is wrong."""
    seconds: float
    dispatches: int
    longest_dispatch_seconds: float
    device: str
    device_bytes: int
    """Of cells and bricks."""
    brick_uploads: int = 0
    """Bricks loaded into the pool, where `brick_pool_mb` is smaller than the volume."""
    bricks_used: int = 0
    """Different bricks among them."""
    waiting_lanes: int = 0
    """Paths that waited for a brick when a dispatch ended, summed over the dispatches."""


@dataclass(frozen=True)
class RenderResult:
    """The picture as named channels (see `Film.layers`), float32, shape [height, width]."""

    config: RenderConfig
    layers: dict[str, np.ndarray]
    statistics: RenderStatistics

    @property
    def radiance(self) -> np.ndarray:
        """Linear RGB, float32, shape [height, width, 3]."""
        return np.stack([self.layers[name] for name in "RGB"], axis=-1)


def run(
    config: RenderConfig,
    volume: FiberVolume,
    scattering: Mapping[str, Scattering],
    *,
    progress: Progress | None = None,
    options: KernelOptions | None = None,
) -> RenderResult:
    """Render `volume`, whose media scatter as `scattering` says by name (one entry serves all media)."""
    from .gpu.context import device_name, shared_context

    started = time.perf_counter()
    scene = build_scene(config, volume, scattering)
    context = shared_context()
    kernel = Kernel(context, scene, options or KernelOptions())
    try:
        film = _expose(kernel, scene, progress)
    finally:
        kernel.release()
    counts = kernel.counts
    statistics = RenderStatistics(
        paths=counts.samples,
        samples_per_pixel=film.samples,
        scattering_events=counts.scattering_events,
        tracking_steps=counts.steps,
        cut_paths=counts.cut_paths,
        broken_samples=counts.broken_samples,
        majorant_violations=counts.majorant_violations,
        seconds=time.perf_counter() - started,
        dispatches=counts.dispatches,
        longest_dispatch_seconds=counts.longest_dispatch_seconds,
        device=device_name(context),
        device_bytes=kernel.device_bytes,
        brick_uploads=counts.brick_uploads,
        bricks_used=counts.bricks_used,
        waiting_lanes=counts.waiting_lanes,
    )
    return RenderResult(config, film.layers(scene.pool.voxel_size_mm), statistics)


def _expose(kernel: Kernel, scene: Scene, progress: Progress | None) -> Film:
    """All samples of all pixels, in passes that fit the device.

    Where `noise` or `time_s` decide how many, they decide by a trial whose samples are not used again: a
    number that depended on the samples it counts would bias their mean.
    """
    config, first = scene.config, 0
    spp = config.samples_per_pixel
    if (config.noise is not None or config.time_s is not None) and spp > TRIAL_SAMPLES:
        started = time.perf_counter()
        trial = _trace(kernel, scene, range(TRIAL_SAMPLES), None)
        spp = samples_needed(config, trial, time.perf_counter() - started)
        first = TRIAL_SAMPLES
    return _trace(kernel, scene, range(first, first + spp), progress)


def samples_needed(config: RenderConfig, trial: Film, seconds: float) -> int:
    """The fewer of what `noise` and `time_s` ask for per pixel, by a trial that took some seconds."""
    wished = [config.samples_per_pixel]
    if config.noise is not None:
        wished.append(math.ceil(trial.samples * (trial.relative_error() / config.noise) ** 2))
    if config.time_s is not None:
        wished.append(int((config.time_s - seconds) / seconds * trial.samples))
    return max(min(wished), 2)


def _trace(kernel: Kernel, scene: Scene, samples: range, progress: Progress | None) -> Film:
    """These samples of all pixels."""
    _, top, width, height = scene.config.window
    spp = len(samples)
    options = kernel.options
    filtered = scene.config.filter.kind != "box"
    film = Film.empty(width, height, layers=scene.film_layers, filtered=filtered)
    report = _Reporter(progress, width * height * spp)
    rows_per_pass = options.rows_per_pass or max(1, PIXELS_PER_PASS // width)
    for first in range(0, height, rows_per_pass):
        rows = range(top + first, top + min(first + rows_per_pass, height))
        for begin in range(samples.start, samples.stop, SAMPLES_PER_PASS):
            part = range(begin, min(begin + SAMPLES_PER_PASS, samples.stop))
            film.add(first * width, kernel.trace(rows, part, tick=report.add))
    film.samples = spp
    return film


class _Reporter:
    """Passes finished samples on to a progress callback, a few times per second."""

    def __init__(self, progress: Progress | None, total: int) -> None:
        self.progress, self.total, self.done = progress, total, 0
        self.started = self.last = time.perf_counter()

    def add(self, samples: int) -> None:
        self.done += samples
        now = time.perf_counter()
        if self.progress is None or (now - self.last < PROGRESS_SECONDS and self.done < self.total):
            return
        self.last = now
        speed = self.done / max(now - self.started, 1e-9) / 1e6
        left = (self.total - self.done) / max(self.done, 1) * (now - self.started)
        detail = f"{self.done} of {self.total} paths, {speed:.3f} M/s, {left:.0f} s left"
        self.progress(self.done / self.total, detail)


def save(result: RenderResult, path: str | Path) -> None:
    """Write .exr with all layers and a .png preview beside it; only the preview for a .png path."""
    path = Path(path)
    if path.suffix.lower() != ".png":
        write_exr(path, result.layers, attributes(result))
    write_preview(path.with_suffix(".png"), result.radiance, exposure=result.config.exposure)


def attributes(result: RenderResult) -> dict[str, object]:
    """Where the picture comes from, for the file's header."""
    text = json.dumps(_without_folders(result.config.model_dump()))
    s = result.statistics
    return {
        "weft.version": _version(),
        "weft.config": text,
        "weft.configSha256": hashlib.sha256(text.encode()).hexdigest(),
        "weft.samplesPerPixel": s.samples_per_pixel,
        "weft.window": ", ".join(str(n) for n in result.config.window),
        "weft.seed": str(result.config.seed),
        "weft.device": s.device,
        "weft.cutPaths": str(s.cut_paths),
        "weft.extinction": result.config.extinction,
    }


def _without_folders(value: object) -> object:
    """Settings as JSON holds them, files by their names alone: a picture tells nothing about the machine."""
    if isinstance(value, Path):
        return value.name
    if isinstance(value, Mapping):
        return {key: _without_folders(part) for key, part in value.items()}
    return [_without_folders(part) for part in value] if isinstance(value, list | tuple) else value


def _version() -> str:
    try:
        return version("weft")
    except PackageNotFoundError:
        return "unknown"
