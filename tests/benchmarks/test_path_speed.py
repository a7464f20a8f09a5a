"""What a path costs: fibers against isotropic scattering, cloth as its extent grows, and a million samples.

`python -m pytest tests/benchmarks/test_path_speed.py -s -m benchmark` prints CPU seconds as ratios of one run
and asserts nothing about them. On a GPU CPU seconds mean nothing.
"""

from __future__ import annotations

import os
import resource
import time
from dataclasses import dataclass, replace

import numpy as np
import pytest

from tests.fiber_model.scattering.scattering_cases import preset
from tests.peers.scenes import twisted_yarns, yarn_axes
from tests.peers.weft_volume import FIBER_RADIUS_MM, dense_volume
from weft.renderer import render
from weft.renderer.config import ConstantLight, PerspectiveCamera, RenderConfig, SkyLight
from weft.renderer.gpu.context import shared_context
from weft.renderer.kernel import Counts, Kernel, KernelOptions
from weft.renderer.passes import Pass
from weft.renderer.scene import build_scene
from weft.renderer.simple_phases import IsotropicPhase
from weft.voxelize.grid import BRICK_SIZE, FiberGrid, FiberVolume

pytestmark = [pytest.mark.gl, pytest.mark.benchmark]

RESOLUTION = 64
ROUNDS = 3


@dataclass(frozen=True)
class Cost:
    """Of the paths of a picture, without loading and compiling; the least of some rounds."""

    seconds: float
    counts: Counts

    @property
    def per_path(self) -> float:
        return self.seconds / self.counts.samples

    @property
    def per_event(self) -> float:
        return self.seconds / self.counts.scattering_events

    def line(self, name: str) -> str:
        steps, events = (n / self.counts.samples for n in (self.counts.steps, self.counts.scattering_events))
        return (
            f"  {name:24s} {1e6 * self.per_path:6.2f} us per path, {steps:6.1f} steps and "
            f"{events:5.2f} scatterings; {1e6 * self.per_event:.2f} us per scattering"
        )


def cost(config: RenderConfig, volume: FiberVolume, scattering) -> Cost:
    kernel = Kernel(shared_context(), build_scene(config, volume, {"fiber": scattering}), KernelOptions())
    work = Pass((0, 0, *config.resolution), range(config.samples_per_pixel))
    kernel.trace(replace(work, samples=range(1)))
    seconds = []
    for _ in range(ROUNDS):
        kernel.counts = Counts()
        started = time.process_time()
        kernel.trace(work)
        seconds.append(time.process_time() - started)
    found = Cost(min(seconds), kernel.counts)
    kernel.release()
    return found


def test_fibers_against_isotropic_scattering():
    """One volume whose extinction follows the fibers, under two phase functions."""
    scene = replace(twisted_yarns(128, peak_extinction=120.0, resolution=RESOLUTION), axes=yarn_axes(128))
    volume = dense_volume(scene)
    config = RenderConfig(
        resolution=(RESOLUTION, RESOLUTION),
        samples_per_pixel=64,
        max_bounces=1000,
        camera=PerspectiveCamera(
            position_mm=scene.camera_position, target_mm=scene.camera_target, fov_deg=scene.fov_deg
        ),
        lights=(SkyLight(),),
    )
    isotropic = cost(config, volume, IsotropicPhase((0.95, 0.95, 0.95)))
    print(f"\n128^3 voxels, load {os.getloadavg()[0]:.1f}\n" + isotropic.line("isotropic"))
    for name in ("reference", "khungurn2015_silk"):
        fiber = cost(config, volume, preset(name))
        print(fiber.line(name))
        print(f"    {fiber.per_event / isotropic.per_event:.2f} times the time per scattering")


def sheet(extent: int) -> FiberVolume:
    """A wavy sheet of noisy cloth, 12 voxels thick, in a cube of `extent` voxels of 0.025 mm."""
    middle = (np.arange(extent) + 0.5) / extent
    x, z = np.meshgrid(middle, middle, indexing="ij")
    height = extent * (0.5 + 0.25 * np.sin(7 * x + 2 * z) + 0.2 * np.sin(6 * z - 3 * x))
    columns = height.reshape(extent // BRICK_SIZE, BRICK_SIZE, extent // BRICK_SIZE, BRICK_SIZE)
    low = np.floor((columns.min(axis=(1, 3)) - 6) / BRICK_SIZE).astype(int)
    high = np.floor((columns.max(axis=(1, 3)) + 6) / BRICK_SIZE).astype(int)
    layers = [np.argwhere((low <= layer) & (layer <= high)) for layer in range(extent // BRICK_SIZE)]
    bricks = np.concatenate([np.insert(found, 1, layer, axis=1) for layer, found in enumerate(layers)])
    bricks = bricks[np.lexsort(bricks.T[::-1])]
    density = np.empty((len(bricks), BRICK_SIZE**3), np.float32)
    rng = np.random.default_rng(3)
    y = np.arange(BRICK_SIZE)[None, None, :, None] + 0.5
    for begin in range(0, len(bricks), 4096):
        part = bricks[begin : begin + 4096]
        surface = columns[part[:, 0], :, part[:, 2], :][:, :, None, :]
        inside = np.abs(y + BRICK_SIZE * part[:, 1, None, None, None] - surface) < 6
        noise = rng.random(inside.shape, np.float32) ** 2
        density[begin : begin + 4096] = (20 * inside * noise).reshape(len(part), -1)
    direction = np.broadcast_to(np.float32([1, 0, 0]), (*density.shape, 3))
    grid = FiberGrid(0.025, FIBER_RADIUS_MM, (bricks * BRICK_SIZE).astype(np.int32), density, direction)
    return FiberVolume({"fiber": grid})


def test_cloth_of_growing_extent():
    """The same cloth, more of it: a global majorant would look up four times as many voxels."""
    config = RenderConfig(
        resolution=(RESOLUTION, RESOLUTION),
        samples_per_pixel=32,
        max_bounces=1000,
        camera=PerspectiveCamera(view_direction=(0.4, 0.6, 1.0)),
        lights=(ConstantLight(),),
        extinction="isotropic",
        isotropic_extinction_per_mm=1.0,
    )
    print()
    first = None
    for extent in (256, 512, 1024):
        found = cost(config, sheet(extent), IsotropicPhase((0.95, 0.95, 0.95)))
        first = first or found
        print(found.line(f"{extent}^3"))
        print(f"    {found.per_path / first.per_path:.2f} times the first, load {os.getloadavg()[0]:.1f}")


def test_a_million_samples_take_no_more_memory():
    """4 x 4 pixels, 10^6 samples each: resident memory after 10^4 of them and after all."""
    volume = dense_volume(twisted_yarns(64, peak_extinction=60.0, resolution=4))
    peaks, seconds = [], []
    for samples in (10_000, 1_000_000):
        config = RenderConfig(
            resolution=(4, 4),
            samples_per_pixel=samples,
            block_samples=1024,
            lights=(ConstantLight(),),
            extinction="isotropic",
            isotropic_extinction_per_mm=1.0,
        )
        started = time.process_time()
        result = render.run(config, volume, {"fiber": IsotropicPhase((0.95, 0.95, 0.95))})
        seconds.append(time.process_time() - started)
        peaks.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
        assert result.statistics.paths == 16 * samples
    print(f"\n  at most {peaks[0]:.0f} MiB after 10^4 samples, {peaks[1]:.0f} MiB after 10^6")
    print(f"  {seconds[0]:.1f} and {seconds[1]:.1f} CPU s")
