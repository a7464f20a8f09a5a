"""Independent pictures of `twisted_yarns` by one program, and their CPU seconds, in a process of their
own.

`python -m tests.peers.speed_images weft|scalar_rgb|llvm_ad_rgb out.npz '{"voxels": 256, ...}'`. One
thread each. What comes before the first sample (loading, compiling) is left out for every program:
a picture is made first.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.peers.mitsuba_volume import VolumeScene
from tests.peers.scenes import twisted_yarns


@dataclass(frozen=True)
class SpeedJob:
    """The scene, and how many pictures of it with how many samples per pixel."""

    voxels: int = 256
    resolution: int = 64
    samples: int = 16
    runs: int = 6
    sampling: str = "both"
    """weft's way to find light."""
    rng: str = "pcg4d"
    """weft's random numbers."""

    def scene(self) -> VolumeScene:
        """The optical depth per yarn is the same whatever the resolution of the grid."""
        return twisted_yarns(self.voxels, peak_extinction=60.0, resolution=self.resolution)


def main(program: str, out: Path, job: SpeedJob) -> None:
    render = _weft(job) if program == "weft" else _mitsuba(program, job)
    render(0)
    started = time.process_time()
    images = [render(1 + run) for run in range(job.runs)]
    seconds = time.process_time() - started
    np.savez(out, images=np.stack(images), seconds=seconds)


def _weft(job: SpeedJob) -> Callable[[int], np.ndarray]:
    os.environ["LP_NUM_THREADS"] = "1"
    from tests.peers.weft_volume import dense_volume, phase_of, render_config
    from weft.renderer.gpu.context import shared_context
    from weft.renderer.kernel import Kernel, KernelOptions
    from weft.renderer.passes import Pass
    from weft.renderer.scene import build_scene

    scene = job.scene()
    config = render_config(scene, samples=job.samples, seed=0).model_copy(
        update={"sampling": job.sampling, "rng": job.rng}
    )
    volume, phase = dense_volume(scene), {"fiber": phase_of(scene)}
    kernel = Kernel(shared_context(), build_scene(config, volume, phase), KernelOptions())
    base = kernel.scene

    def render(seed: int) -> np.ndarray:
        # other samples of the same pixels, rather than a new seed, which would build the scene anew
        first = seed * job.samples
        work = Pass((0, 0, job.resolution, job.resolution), range(first, first + job.samples))
        sums = kernel.trace(work).astype(np.float64).sum(axis=0)[0]
        picture: np.ndarray = sums[:, :3].mean(axis=1).reshape(job.resolution, -1) / job.samples
        return picture

    assert base.config.block_samples <= job.samples
    return render


def _mitsuba(variant: str, job: SpeedJob) -> Callable[[int], np.ndarray]:
    import drjit as dr
    import mitsuba as mi

    from tests.peers.mitsuba_volume import scene_dict

    mi.set_variant(variant)
    dr.set_thread_count(1)
    loaded = mi.load_dict(scene_dict(mi, job.scene()))

    def render(seed: int) -> np.ndarray:
        picture = mi.render(loaded, spp=job.samples, seed=seed)
        return np.asarray(picture)[..., :3].mean(-1, dtype=np.float64)

    return render


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), SpeedJob(**json.loads(sys.argv[3])))
