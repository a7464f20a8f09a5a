"""The render stage: a volume and its scattering in, a picture with statistics out."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .brick_pool import LevelShare
from .config import RenderConfig
from .exposure import WHOLE, Exposure, Keeping, Share, never
from .identity import picture_origin, scene_identity
from .image import write_exr, write_preview
from .kernel import KernelOptions
from .progress import Progress, Watch
from .room import kernel_that_fits, what_was_made_smaller
from .scene import AnyVolume, Scattering, build_scene

Stopping = AbstractContextManager[Callable[[], bool]]
UNSTOPPED: Stopping = nullcontext(never)


@dataclass(frozen=True)
class RenderStatistics:
    """What a picture cost, and what to distrust in it."""

    paths: int
    samples_per_pixel: int
    """Those that every pixel of the picture has."""
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
    made_smaller: str = ""
    """What the device had no room for, in words; the bits are those of a device that has."""
    detail: tuple[LevelShare, ...] = ()
    """How much of the cloth is drawn at which level, where `detail_pixels` chose."""


@dataclass(frozen=True)
class RenderResult:
    """The picture as named channels (see `Film.layers`), float32, shape [height, width]."""

    config: RenderConfig
    layers: dict[str, np.ndarray]
    statistics: RenderStatistics
    complete: bool = True
    """Whether it has all its samples; a run that was stopped has fewer."""

    @property
    def radiance(self) -> np.ndarray:
        """Linear RGB, float32, shape [height, width, 3]."""
        return np.stack([self.layers[name] for name in "RGB"], axis=-1)


def run(
    config: RenderConfig,
    volume: AnyVolume,
    scattering: Mapping[str, Scattering],
    *,
    progress: Progress | None = None,
    watch: Watch | None = None,
    options: KernelOptions | None = None,
    keeping: Keeping | None = None,
    share: Share = WHOLE,
    stopping: Stopping = UNSTOPPED,
) -> RenderResult:
    """Render `volume`, whose media scatter as `scattering` says by name (one entry serves all media).

    `stopping` is entered while samples are taken and yields a question that is asked after every dispatch;
    once the answer is yes, the result holds what is finished. Raises `MergeError` where
    the checkpoint to resume is of another picture.
    """
    from .gpu.context import device_name, shared_context

    started, options = time.perf_counter(), options or KernelOptions()
    scene = build_scene(config, volume, scattering)
    context = shared_context()
    kernel = kernel_that_fits(context, scene, options)
    identity = None
    if keeping is not None:
        identity = scene_identity(scene, volume.content_sha256, device_name(context))
    try:
        with stopping as stop:
            exposure = Exposure(
                kernel,
                kernel.scene,
                identity=identity,
                origin=picture_origin(config, device_name(context)),
                keeping=keeping,
                share=share,
                stop=stop,
                progress=progress,
                watch=watch,
            )
            complete = exposure.run()
    finally:
        kernel.release()
    film, counts = exposure.film(), kernel.counts
    statistics = RenderStatistics(
        paths=counts.samples,
        samples_per_pixel=film.fewest_samples,
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
        made_smaller=what_was_made_smaller(scene, options, kernel),
        detail=scene.pool.detail,
    )
    return RenderResult(config, film.layers(scene.pool.voxel_size_mm), statistics, complete)


def save(result: RenderResult, path: str | Path) -> None:
    """Write .exr with all layers and a .png preview beside it; only the preview for a .png path."""
    path = Path(path)
    if path.suffix.lower() != ".png":
        write_exr(path, result.layers, attributes(result))
    write_preview(path.with_suffix(".png"), result.radiance, exposure=result.config.exposure)


def attributes(result: RenderResult) -> dict[str, object]:
    """Where the picture comes from, for the file's header."""
    s = result.statistics
    return picture_origin(result.config, s.device) | {
        "weft.samplesPerPixel": s.samples_per_pixel,
        "weft.complete": int(result.complete),
        "weft.cutPaths": str(s.cut_paths),
        **({"weft.detail": ", ".join(described_detail(s))} if s.detail else {}),
    }


def described_detail(statistics: RenderStatistics) -> list[str]:
    """How much of the cloth is drawn in which voxels, and how far these are off, as far as that is known."""
    return [
        f"{share.fiber_share:.0%} of the fiber in voxels of {share.voxel_size_mm:g} mm"
        + (f" (extinction off by {share.extinction_error_rms:.2g})" if share.extinction_error_rms else "")
        for share in statistics.detail
        if share.brick_count
    ]
