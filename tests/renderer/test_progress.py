"""The picture while it is made: looks change no bit, show what is finished, and take little of the time."""

from __future__ import annotations

import numpy as np
import pytest

from weft.renderer.config import ConstantLight, RenderConfig
from weft.renderer.film import Film
from weft.renderer.kernel import KernelOptions
from weft.renderer.progress import ProgressReport, Watch, noise_so_far, radiance_so_far
from weft.renderer.render import run
from weft.renderer.scene import IsotropicPhase

from .volumes import random_grid, volume

GRID = volume(random_grid((2, 2, 1), seed=5, peak=0.5, fill=0.6))
CONFIG = RenderConfig(resolution=(32, 24), samples_per_pixel=32, lights=[ConstantLight()], block_samples=8)
SMALL_STEPS = KernelOptions(lane_count=256, rounds_per_dispatch=4)


def render(watch=None, progress=None):
    lobes = {"a": IsotropicPhase((0.8, 0.8, 0.8))}
    return run(CONFIG, GRID, lobes, watch=watch, progress=progress, options=SMALL_STEPS)


@pytest.mark.gl
def test_looking_changes_no_bit_and_shows_finished_pixels_as_they_will_be():
    """Pixels that have all their samples at some look have the radiance of the picture."""
    looks, said = [], []

    def look(film):
        looks.append((np.broadcast_to(film.samples, 32 * 24).copy(), radiance_so_far(film).reshape(-1, 3)))

    watched = render(Watch(look, first_s=0.0), lambda fraction, detail: said.append(detail))
    plain = render()
    assert looks
    for name, layer in plain.layers.items():
        np.testing.assert_array_equal(watched.layers[name], layer)
    shares = [samples.sum() for samples, _ in looks]
    assert shares == sorted(shares)
    assert 0 < shares[-1] <= 32 * 24 * 32
    for samples, radiance in looks:
        assert not radiance[samples == 0].any()
        whole = samples == 32
        np.testing.assert_allclose(radiance[whole], plain.radiance.reshape(-1, 3)[whole], rtol=1e-6)
    assert "M/s" in said[-1]
    assert " left" in said[-1]


def test_the_noise_so_far_is_that_of_the_finished_pixels():
    values = np.random.default_rng(1).exponential(size=(400, 16))
    film = Film.empty(400, 1)
    film.samples = np.where(np.arange(400) < 100, 16, 0)
    film.sums[0, :100, 1] = values[:100].sum(axis=1)
    film.sums[1, :100, 1] = (values[:100] ** 2).sum(axis=1)
    expected = np.sqrt((values[:100].var(axis=1) / 15).mean()) / values[:100].mean()
    assert noise_so_far(film) == pytest.approx(expected, rel=1e-9)
    assert noise_so_far(Film.empty(4, 4)) is None


def test_looks_become_rarer_and_take_a_twentieth_of_the_time(monkeypatch):
    now, looks = [0.0], []
    monkeypatch.setattr("weft.renderer.progress.time.perf_counter", lambda: now[0])

    def film():
        now[0] += 0.5  # a look takes half a second
        return Film.empty(2, 2)

    watch = Watch(lambda film: looks.append(now[0]), first_s=2.0)
    report = ProgressReport(None, 10_000, 0, watch=watch, film=film)
    while now[0] < 300:
        now[0] += 0.1
        report.add(1)
    assert looks[0] == pytest.approx(2.5, abs=0.2)
    assert min(np.diff(looks)) > 9.9
    assert 0.5 * len(looks) < 0.05 * 300
