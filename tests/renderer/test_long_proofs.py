"""Statements that take minutes: the furnace over five decades of density; how noise falls with samples."""

from __future__ import annotations

import math

import numpy as np
import pytest

from weft.renderer.config import ConstantLight, DirectionalLight, OrthographicCamera, RenderConfig
from weft.renderer.render import run

from .statistics import Z_LIMIT, picture_mean, z_score
from .test_transport import TABLE
from .volumes import uniform_grid, volume

pytestmark = [pytest.mark.gl, pytest.mark.proof]

DENSITIES = (1e-2, 1e-1, 1.0, 10.0, 100.0, 1000.0)


def furnace(density: float, *, resolution: int, samples: int, **settings):
    """One brick of white fibers in uniform light. At density 1000 light scatters 17,000 times on average."""
    config = RenderConfig(
        resolution=(resolution, resolution),
        samples_per_pixel=samples,
        max_bounces=2**31 - 1,
        camera=OrthographicCamera(view_direction=(0.3, 0.4, 1.0), frame_width_mm=0.2),
        lights=[ConstantLight()],
        background="environment",
        **settings,
    )
    grid = uniform_grid((1, 1, 1), density, (0.0, 0.6, 0.8))
    return run(config, volume(grid), {"a": TABLE["reference"]})


@pytest.mark.parametrize("density", DENSITIES)
def test_every_path_of_a_white_volume_brings_back_one(density):
    """Within 0.1 %, path by path: phase sampling alone has no variance to hide behind."""
    samples = 4 if density < 500 else 1
    result = furnace(density, resolution=16, samples=samples, sampling="phase", roulette_start=2**31 - 1)
    np.testing.assert_allclose(result.radiance, 1, rtol=1e-3)
    assert result.statistics.cut_paths == 0


@pytest.mark.parametrize("density", DENSITIES[:5])
def test_light_and_phase_sampling_together_keep_it_white(density):
    """Error probability 1e-4 per z; standard errors up to 0.5 %."""
    result = furnace(density, resolution=32, samples=32 if density < 50 else 8, sampling="both_plain")
    assert abs(z_score(result, 1.0)) < Z_LIMIT
    assert picture_mean(result)[1] < 0.005


def test_noise_falls_with_the_root_of_samples():
    """Slope -0.50 +- 0.02 of log RMSE over three decades, from the difference of two independent pictures.

    576 pixels make each RMSE good to 3 %, the slope over ten octaves to 0.005.
    """
    counts = 2 ** np.arange(2, 13)
    errors = []
    for count in counts:
        pictures = [
            run(
                RenderConfig(
                    resolution=(24, 24),
                    samples_per_pixel=int(count),
                    seed=seed,
                    max_bounces=4,
                    camera=OrthographicCamera(view_direction=(0.2, 0.1, 1.0), frame_width_mm=1e-3),
                    lights=[ConstantLight(), DirectionalLight(direction=(1, 2, 1))],
                ),
                volume(uniform_grid((1, 1, 1), 0.05, (0.0, 0.6, 0.8))),
                {"a": TABLE["reference"]},
            ).radiance[..., 1]
            for seed in (1, 2)
        ]
        errors.append(math.sqrt(np.mean((pictures[0] - pictures[1]) ** 2) / 2))
    slope = np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert abs(slope + 0.5) < 0.02
