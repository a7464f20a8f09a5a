"""Stopping by noise or time: a trial says how many samples it takes, and is not in the picture."""

from __future__ import annotations

import numpy as np
import pytest

from weft.renderer.config import ConstantLight, RenderConfig
from weft.renderer.exposure import TRIAL_SAMPLES, samples_needed
from weft.renderer.film import Film
from weft.renderer.render import attributes, run
from weft.renderer.scene import IsotropicPhase

from .volumes import random_grid, volume

GRID = volume(random_grid((2, 2, 1), seed=5, peak=0.5, fill=0.6))
CONFIG = RenderConfig(resolution=(24, 24), samples_per_pixel=4096, lights=[ConstantLight()])


def render(**settings):
    return run(CONFIG.model_copy(update=settings), GRID, {"a": IsotropicPhase((0.8, 0.8, 0.8))})


def relative_error(result):
    variance = result.layers["variance.G"].astype(float)
    return np.sqrt(variance.mean()) / result.radiance[..., 1].mean()


@pytest.mark.gl
@pytest.mark.parametrize("noise", [0.1, 0.05])
def test_noise_comes_out_as_asked(noise):
    result = render(noise=noise)
    assert relative_error(result) == pytest.approx(noise, rel=0.15)
    assert (result.layers["samples"] == result.statistics.samples_per_pixel).all()
    assert attributes(result)["weft.samplesPerPixel"] == result.statistics.samples_per_pixel


@pytest.mark.gl
def test_the_trials_samples_are_not_in_the_picture():
    """They lie behind all others: the picture is, bit by bit, that of its number of samples asked for."""
    stopped = render(noise=0.1)
    count = stopped.statistics.samples_per_pixel
    assert stopped.statistics.paths == 24 * 24 * (TRIAL_SAMPLES + count)
    plain = render(samples_per_pixel=count)
    assert plain.statistics.paths == 24 * 24 * count
    np.testing.assert_array_equal(stopped.radiance, plain.radiance)


@pytest.mark.gl
def test_samples_per_pixel_stay_the_most():
    assert render(noise=1e-6, samples_per_pixel=20).statistics.samples_per_pixel == 20
    assert render(noise=1e-6, samples_per_pixel=4).statistics.paths == 24 * 24 * 4


def test_time_is_divided_by_the_speed_of_the_trial():
    film = Film.empty(4, 4)
    film.samples = 8
    config = CONFIG.model_copy(update={"time_s": 11.0})
    assert samples_needed(config, film, 0.5) == 168
    assert samples_needed(config, film, 20.0) == 2
    assert samples_needed(config.model_copy(update={"samples_per_pixel": 100}), film, 0.5) == 100
