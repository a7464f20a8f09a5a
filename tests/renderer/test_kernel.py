"""Cutting the work up changes no bit of the picture, and nothing is cut off."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from weft.renderer.config import DirectionalLight, PerspectiveCamera, RenderConfig, StudioLight
from weft.renderer.gpu.context import shared_context
from weft.renderer.gpu.programs import compute_program
from weft.renderer.kernel import LOOP_BUDGET, Kernel, KernelOptions
from weft.renderer.passes import Pass
from weft.renderer.render import run
from weft.renderer.scene import build_scene

from .test_transport import TABLE
from .volumes import random_grid, volume

pytestmark = pytest.mark.gl

CONFIG = RenderConfig(
    resolution=(24, 20),
    samples_per_pixel=5,
    block_samples=2,
    seed=9,
    lights=[StudioLight(), DirectionalLight(direction=(1, 2, 3))],
    camera=PerspectiveCamera(view_direction=(0.2, 0.3, 1.0)),
)
GRIDS = (random_grid((3, 3, 2), seed=51, peak=0.6, brick_fill=0.7), random_grid((2, 3, 3), seed=52, peak=0.1))


def picture(config=CONFIG, **options):
    return run(
        config,
        volume(*GRIDS),
        {"a": TABLE["reference"], "b": TABLE["rougher"]},
        options=KernelOptions(**options),
    )


@pytest.fixture(scope="module")
def usual():
    return picture()


@pytest.mark.parametrize(
    "options",
    [
        {"rounds_per_dispatch": 1},
        {"rounds_per_dispatch": 7},
        {"lane_count": 64},
        {"lane_count": 4096, "rounds_per_dispatch": 3},
        {"steps_per_round": 1},
        {"steps_per_round": 5, "lane_count": 128},
        {"rows_per_pass": 3},
        {"blocks_per_pass": 1},
        {"blocks_per_pass": 3, "rows_per_pass": 7},
    ],
    ids=str,
)
def test_no_scheduling_changes_a_bit(usual, options):
    other = picture(**options)
    for name, layer in usual.layers.items():
        np.testing.assert_array_equal(layer, other.layers[name], err_msg=name)
    assert other.statistics.scattering_events == usual.statistics.scattering_events
    assert other.statistics.tracking_steps == usual.statistics.tracking_steps


def test_delta_tracking_is_as_deterministic():
    config = CONFIG.model_copy(update={"tracking": "delta"})
    one, two = picture(config, lane_count=64, rounds_per_dispatch=2), picture(config)
    np.testing.assert_array_equal(one.radiance, two.radiance)


def test_the_seed_matters(usual):
    other = picture(CONFIG.model_copy(update={"seed": 10}))
    assert not np.array_equal(usual.radiance, other.radiance)


def test_every_pixel_gets_its_samples(usual):
    width, height = CONFIG.resolution
    assert usual.statistics.paths == width * height * CONFIG.samples_per_pixel
    assert usual.statistics.broken_samples == 0


def test_more_samples_continue_the_same_sequence():
    """The mean of 4 samples is that of samples 0..1 and 2..3."""
    scene = build_scene(
        CONFIG.model_copy(update={"block_samples": 4}), volume(*GRIDS), {"a": TABLE["reference"]}
    )
    kernel = Kernel(shared_context(), scene, KernelOptions(lane_count=256))
    window = (0, 0, 24, 20)
    parts = [kernel.trace(Pass(window, range(0, 2))), kernel.trace(Pass(window, range(2, 4)))]
    whole = kernel.trace(Pass(window, range(0, 4)))
    np.testing.assert_allclose(parts[0] + parts[1], whole, rtol=1e-5, atol=1e-6)
    kernel.release()


def test_loops_of_a_dispatch_stay_within_the_budget():
    """Canary: the longest dispatch the kernel may choose equals single rounds, in a dense white volume."""
    dense = dataclasses.replace(GRIDS[0], density=GRIDS[0].density * 50)
    config = CONFIG.model_copy(update={"resolution": (8, 8), "samples_per_pixel": 32, "max_bounces": 100_000})
    scene = build_scene(config, volume(dense), {"a": TABLE["reference"]})
    sums = []
    for rounds in (1, None):
        kernel = Kernel(shared_context(), scene, KernelOptions(lane_count=64, rounds_per_dispatch=rounds))
        kernel.rounds = rounds or kernel.most_rounds
        sums.append(kernel.trace(Pass((0, 0, 8, 8), range(32))))
        assert kernel.counts.samples == 64 * 32
        kernel.release()
    assert kernel.most_rounds * (KernelOptions().steps_per_round + 1) <= LOOP_BUDGET
    np.testing.assert_array_equal(sums[0], sums[1])


@pytest.mark.parametrize("media", [1, 2, 8])
def test_the_budget_counts_every_loop(media):
    """Also the loops over the media of a cell, which a driver may or may not unroll."""
    grids = [random_grid((1, 1, 1), seed=i) for i in range(media)]
    scene = build_scene(CONFIG, volume(*grids), {"a": TABLE["reference"]})
    kernel = Kernel(shared_context(), scene, KernelOptions(lane_count=64, rounds_per_dispatch=10**6))
    per_step, per_collision = (media, 2 * media) if media > 1 else (0, 0)
    steps = KernelOptions().steps_per_round
    assert kernel.rounds * (1 + steps * (1 + per_step) + per_collision) <= LOOP_BUDGET
    assert kernel.rounds == kernel.most_rounds > 0
    kernel.release()


LOOPS = """#version 430
layout(local_size_x = 1) in;
layout(std430, binding = 0) buffer Result { uint reached[]; };
uniform uint wished;
void main() {
    uint count = 0u;
    for (uint i = 0u; i < wished; ++i) count += 1u + (reached[1] & i);
    reached[0] = count;
}
"""


def test_the_budget_is_below_what_the_driver_runs():
    """llvmpipe stops at 65,535 iterations without a word; the budget must be reached on every driver."""
    context = shared_context()
    program = compute_program(context, "loops", text=LOOPS, constants={})
    buffer = context.buffer(np.zeros(2, np.uint32))
    buffer.bind_to_storage_buffer(0)
    program["wished"] = 2 * LOOP_BUDGET
    program.run(1)
    assert np.frombuffer(buffer.read(), np.uint32)[0] == 2 * LOOP_BUDGET
