"""One volume drawn again and again while camera, lights or scattering change, from coarse to fine.

The volume and the compiled kernel stay on the device; a change writes only the tables it concerns. A picture
starts at a fraction of the resolution that takes about `FIRST_SECONDS`; the full one then gathers samples.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from weft.voxelize.grid import FiberVolume

from .camera import CameraFrame
from .config import Light, RenderConfig
from .kernel import KernelOptions
from .passes import Pass
from .room import kernel_that_fits
from .scene import Scattering, Scene, build_phase_table, build_scene, lit_scene

FIRST_SECONDS = 0.15
"""What the first, coarse picture may take."""
PASS_SECONDS = 0.6
"""What further samples may take until they are shown."""
COARSEST = 16
FIRST_GUESS = 3e5
"""Paths per second before any were traced."""


class _Stopped(Exception):
    """Something changed, so the samples under way are of no use."""


@dataclass(frozen=True)
class Refinement:
    """The picture so far."""

    radiance: np.ndarray
    """Linear RGB, float32, shape [height, width, 3], at a `scale`-th of the resolution asked for."""
    scale: int
    samples: int
    """Per pixel."""
    noise: float
    """Standard error of a pixel's green, root mean square, relative to the mean; inf of a single sample."""
    paths_per_second: float
    seconds: float
    """Since the last change."""


class ProgressiveRender:
    """A scene on the device, and the picture of it that is being refined.

    All calls have to come from the thread that made the OpenGL context (the first to render).
    """

    def __init__(
        self,
        config: RenderConfig,
        volume: FiberVolume,
        scattering: Mapping[str, Scattering],
        *,
        options: KernelOptions | None = None,
    ) -> None:
        from .gpu.context import shared_context

        self.media, self.bounds_mm = volume.media, np.asarray(volume.bounds_mm)
        config = config.model_copy(
            update={
                "crop": None,
                "noise": None,
                "time_s": None,
                "block_samples": 4096,
                "detail_pixels": None,
            }
        )
        scene = build_scene(config, volume, scattering)
        options = options or KernelOptions(dispatch_seconds=0.05)
        self.kernel = kernel_that_fits(shared_context(), scene, options)
        self.scene = self.kernel.scene
        self.paths_per_second = FIRST_GUESS

    def look(self, camera: CameraFrame, resolution: tuple[int, int]) -> None:
        """From another place, with as many pixels."""
        self._change(replace(self._sized(resolution), camera=camera))

    def light(self, lights: Sequence[Light], axes: np.ndarray) -> None:
        """By other lights; those that belong to a camera turn with `axes` (rows right, up, toward it)."""
        self._change(lit_scene(self.scene, lights, axes, self.bounds_mm))

    def scatter(self, scattering: Mapping[str, Scattering]) -> None:
        """With other fibers."""
        self._change(replace(self.scene, phase=build_phase_table(self.media, scattering)))

    def refine(self, samples: int, stop: Callable[[], bool]) -> Iterator[Refinement]:
        """Better and better pictures until there are `samples` per pixel, or `stop()` says it is enough.

        The first one is finished in any case, so that one sees something also while one drags the camera.
        """
        full, started = self.scene.config.resolution, time.perf_counter()
        sums, stop_now = np.zeros(()), _never
        try:
            for scale, part in self._steps(full, samples):
                size = max(full[0] // scale, 1), max(full[1] // scale, 1)
                traced = self._trace(size, part, stop_now)
                sums = sums + traced if part.start else traced
                stop_now = stop
                yield _refinement(sums, size, scale, part.stop, self, started)
        except _Stopped:
            return
        finally:
            self._change(self._sized(full))

    def _steps(self, full: tuple[int, int], samples: int) -> Iterator[tuple[int, range]]:
        """Scale and samples of each pass, by the speed of those before it."""
        for scale in self._coarse_scales(full):
            yield scale, range(1)
        done = 0
        while done < samples:
            count = int(PASS_SECONDS * self.paths_per_second / (full[0] * full[1]))
            count = min(max(count, 1), samples - done, max(done, 1))
            yield 1, range(done, done + count)
            done += count

    def _coarse_scales(self, full: tuple[int, int]) -> list[int]:
        """From the coarsest that is needed: 8, 4, 2 for one that takes 64 times as long as it may."""
        scales, scale = [], 1
        while scale < COARSEST and full[0] * full[1] > FIRST_SECONDS * self.paths_per_second * scale**2:
            scale *= 2
            scales.append(scale)
        return scales[::-1]

    def _trace(self, size: tuple[int, int], samples: range, stop: Callable[[], bool]) -> np.ndarray:
        """Sums of radiance and of its squares, shape [2, pixel_count, 4]. Raises `_Stopped`."""
        self._change(self._sized(size))
        started = time.perf_counter()

        def tick(finished: int) -> None:
            if stop():
                raise _Stopped

        sums = self.kernel.trace(Pass((0, 0, *size), samples), tick=tick).sum(axis=0)[:2]
        seconds = max(time.perf_counter() - started, 1e-6)
        self.paths_per_second = len(samples) * size[0] * size[1] / seconds
        return sums

    def _sized(self, resolution: tuple[int, int]) -> Scene:
        config = self.scene.config.model_copy(update={"resolution": resolution})
        return replace(self.scene, config=config)

    def _change(self, scene: Scene) -> None:
        self.scene = scene
        self.kernel.change(scene)

    def release(self) -> None:
        """Give the device memory back."""
        self.kernel.release()


def _never() -> bool:
    return False


def _refinement(
    sums: np.ndarray,
    size: tuple[int, int],
    scale: int,
    samples: int,
    render: ProgressiveRender,
    started: float,
) -> Refinement:
    mean = sums[0, :, :3] / samples
    green = mean[:, 1]
    variance = np.maximum(sums[1, :, 1] / samples - green**2, 0) / max(samples - 1, 1)
    noise = float(np.sqrt(variance.mean()) / max(green.mean(), 1e-30)) if samples > 1 else float("inf")
    picture = mean.reshape(size[1], size[0], 3).astype(np.float32)
    seconds = time.perf_counter() - started
    return Refinement(picture, scale, samples, noise, render.paths_per_second, seconds)
