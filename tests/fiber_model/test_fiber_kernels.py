"""The Warp functions against numpy, point by point, and against themselves, bit by bit."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from weft.fiber_model import counter_random
from weft.fiber_model.counter_random import pcg4d, seed_key, uniform_single
from weft.fiber_model.cross_section import sample_cross_section
from weft.fiber_model.fiber_arrays import YarnPlan, plan_yarn
from weft.fiber_model.fiber_curves import strand_points
from weft.fiber_model.fiber_kernels import open_strand, open_strand_point, strand_point
from weft.fiber_model.fiber_tables import FiberTables
from weft.fiber_model.fibers import FiberSet, run
from weft.fiber_model.flyaways import is_loop, loop_peak, sample_hairs
from weft.fiber_model.migration import migration_period_index, migration_phase, migration_radius
from weft.fiber_model.place_kernels import keep_from_folding
from weft.fiber_model.plies import phase_at_nodes, place_in_ply, ply_phase
from weft.fiber_model.random_kernels import pcg4d as warp_pcg4d
from weft.fiber_model.yarns.frames import YarnFrames, build_frames
from weft.fiber_model.yarns.yarns import YarnSet


@wp.kernel
def _words(keys: wp.array(dtype=wp.vec4ui), words: wp.array(dtype=wp.vec4ui)):
    i = wp.tid()
    key = keys[i]
    words[i] = warp_pcg4d(key[0], key[1], key[2], key[3])


@wp.kernel
def _both_ways(tables: FiberTables, stretch: wp.int32, points: wp.array(dtype=wp.vec3, ndim=3)):
    s, k = wp.tid()
    points[0, s, k] = strand_point(tables, stretch, s, k)
    strand = open_strand(tables, stretch, s)
    points[1, s, k] = open_strand_point(tables, strand, k)


@wp.kernel
def _squeezed(offsets: wp.array(dtype=wp.vec3), bend: wp.vec3, kept: wp.array(dtype=wp.vec3)):
    i = wp.tid()
    kept[i] = keep_from_folding(offsets[i], bend)


def _planned(config, yarns: YarnSet, fiber_set: FiberSet) -> tuple[YarnFrames, YarnPlan, int]:
    frames = build_frames(yarns, max_step_mm=float(fiber_set.report.segment_mm) * (1 + 1e-9))
    intervals = int(frames.interval_counts[0])
    plan = plan_yarn(config, yarns.radius[0], frames.length[0], intervals, closed=bool(yarns.closed[0]))
    return frames, plan, seed_key(config.seed)


def _squeeze(offset: np.ndarray, bend: np.ndarray) -> np.ndarray:
    reach = (offset * bend).sum(axis=-1, keepdims=True)
    kept = np.where(reach > 0.8, 0.8 + 0.15 * (1 - np.exp((0.8 - reach) / 0.15)), reach)
    return offset - bend * (reach - kept) / np.maximum((bend**2).sum(axis=-1, keepdims=True), 1e-30)


def _place(
    x: np.ndarray, y: np.ndarray, ply_turns: np.ndarray, frames: YarnFrames, at: np.ndarray, plan: YarnPlan
) -> np.ndarray:
    """World points at the (fractional) nodes `at`; the frame between nodes is linear, as in the kernel."""
    low = np.minimum(np.floor(at).astype(int), plan.intervals - 1)
    t = (at - low)[..., None]
    tangent = frames.tangent

    def between(values: np.ndarray) -> np.ndarray:
        return values[low] * (1 - t) + values[low + 1] * t

    bend = np.gradient(tangent, plan.step, axis=0)
    if plan.closed:
        bend[0] = bend[-1] = (tangent[1] - tangent[-2]) / (2 * plan.step)
    plane = place_in_ply(x, y, ply_turns, plan.plies)
    normal, binormal = between(frames.normal), between(np.cross(tangent, frames.normal))
    offset = plane[..., :1] * normal + plane[..., 1:] * binormal
    return between(frames.position) + _squeeze(offset, between(bend))


def _body_reference(config, yarns: YarnSet, fiber_set: FiberSet) -> np.ndarray:
    """All body fibers of the first yarn from the numpy steps, float64, shape [fiber_count, node_count, 3]."""
    frames, plan, seed = _planned(config, yarns, fiber_set)
    fiber = np.arange(plan.fiber_count)
    zero = np.zeros_like(fiber)
    own, angle = sample_cross_section(
        seed, zero, fiber, epsilon=config.cross_section_epsilon, beta=config.cross_section_beta
    )
    own, fiber = own[:, None], fiber[:, None]
    node = np.arange(plan.intervals + 1)
    start = migration_phase(seed, zero, fiber[:, 0])[:, None]
    turns = node * (plan.migration_turns / plan.intervals) + start
    period = migration_period_index(turns)
    if plan.closed:
        last = turns[:, :1]
        turns, period = (
            np.concatenate([turns[:, :-1], last], axis=1),
            period % max(int(plan.migration_turns), 1),
        )
        period[:, -1] = period[:, 0]
    peak = config.migration_max * own * np.ones_like(turns)
    loops = is_loop(seed, 0, fiber, period, plan.flyaways.loop_probability)
    drawn = loop_peak(seed, 0, fiber, period, peak, plan.flyaways.loop_radius)
    peak = np.where(loops, drawn, peak)
    radius = migration_radius(own, turns, low=config.migration_min, peak=peak)
    twist = 2 * np.pi * phase_at_nodes(plan.fiber_turns, plan.intervals) + angle[:, None]
    ply = fiber // plan.plies.fibers_per_ply
    ply_turns = (
        phase_at_nodes(plan.ply_turns, plan.intervals) + ply_phase(seed, zero[:1])[0] + ply / config.plies
    )
    at = np.broadcast_to(node.astype(float), radius.shape)
    return _place(radius * np.cos(twist), radius * np.sin(twist), ply_turns, frames, at, plan)


def _hair_reference(config, yarns: YarnSet, fiber_set: FiberSet, stretch: int) -> np.ndarray:
    """The hairs of one stretch of the first yarn, float64, shape [hair_count, points, 3]."""
    frames, plan, seed = _planned(config, yarns, fiber_set)
    record = fiber_set.stretches[stretch]
    number = np.arange(record["hairs"])
    hairs = sample_hairs(seed, 0, np.full_like(number, stretch), number, config.plies, plan.flyaways)
    begin = hairs.start.astype(np.float64) * record["segments"] + record["first"]
    span = hairs.z_span.astype(np.float64) / plan.step
    end = begin + span
    if not plan.closed:
        end = np.clip(end, 0, plan.intervals)
    extent = (end - begin) / span
    t = extent[:, None] * np.linspace(0, 1, config.hair_segments + 1)
    at = begin[:, None] + span[:, None] * t
    at = at % plan.intervals if plan.closed else np.clip(at, 0, plan.intervals)
    radius = hairs.radius[:, None] + hairs.radius_span[:, None] * t
    angle = 2 * np.pi * hairs.angle[:, None].astype(np.float64) + hairs.angle_span[:, None] * t
    ply_turns = at / plan.intervals * plan.ply_turns + ply_phase(seed, np.zeros(1, int))[0]
    ply_turns = ply_turns + hairs.ply[:, None] / config.plies
    return _place(radius * np.cos(angle), radius * np.sin(angle), ply_turns, frames, at, plan)


def _split(fiber_set: FiberSet, stretch: int) -> tuple[np.ndarray, np.ndarray]:
    """Body fibers and hairs of a stretch, shapes [count, points, 3]."""
    points = strand_points(fiber_set, np.array([stretch])).points
    hairs = int(fiber_set.stretches["hairs"][stretch])
    body = int(fiber_set.stretch_strand_counts()[stretch]) - hairs
    nodes = int(fiber_set.stretches["segments"][stretch]) + 1
    return points[: body * nodes].reshape(body, nodes, 3), points[body * nodes :].reshape(
        hairs, fiber_set.config.hair_segments + 1, 3
    )


def test_pcg4d_equals_numpy() -> None:
    keys = np.random.default_rng(0).integers(0, 2**32, (1000, 4), dtype=np.uint32)
    words = wp.empty(1000, dtype=wp.vec4ui, device="cpu")
    wp.launch(_words, 1000, inputs=[wp.array(keys, dtype=wp.vec4ui, device="cpu"), words], device="cpu")
    assert (words.numpy() == np.stack(pcg4d(*keys.T), axis=1)).all()


@pytest.mark.parametrize(
    ("preset", "values"),
    [
        ("cotton1", {}),
        ("rayon3", {"scale": "as_fitted"}),
        ("polyester1", {"fuzz": 2.0, "fiber_count_scale": 1.0}),
    ],
)
@pytest.mark.parametrize("closed", [False, True])
def test_body_fibers_equal_numpy(preset, values, closed, fiber_config, straight_yarn, yarn_loop) -> None:
    config = fiber_config(preset, seed=11, fiber_count_scale=values.get("fiber_count_scale", 0.5), **{
        k: v for k, v in values.items() if k != "fiber_count_scale"})  # fmt: skip
    yarns = yarn_loop(2.0, 0.25) if closed else straight_yarn(9.0, 0.25)
    fiber_set = run(config, yarns)
    expected = _body_reference(config, yarns, fiber_set)
    for stretch in range(fiber_set.stretch_count):
        first = int(fiber_set.stretches["first"][stretch])
        body, _ = _split(fiber_set, stretch)
        assert np.abs(body - expected[:, first : first + body.shape[1]]).max() < 3e-6


@pytest.mark.parametrize("closed", [False, True])
def test_hairs_equal_numpy(closed, fiber_config, straight_yarn, yarn_loop) -> None:
    config = fiber_config(
        "cotton1", seed=5, fiber_count_scale=0.1, fuzz=2.0, segment_mm=0.02, ply_pitch_mm=1e3
    )
    yarns = yarn_loop(2.0, 0.25) if closed else straight_yarn(6.0, 0.25)
    fiber_set = run(config, yarns)
    for stretch in (0, 3, fiber_set.stretch_count - 1):
        _, hairs = _split(fiber_set, stretch)
        expected = _hair_reference(config, yarns, fiber_set, stretch)
        assert len(hairs) > 1
        assert np.abs(hairs - expected).max() < 2e-5


def test_hairs_stay_on_an_open_yarn(fiber_config, straight_yarn) -> None:
    fiber_set = run(fiber_config("cotton1", fuzz=5.0, fiber_count_scale=0.01), straight_yarn(5.0))
    for stretch in range(fiber_set.stretch_count):
        _, hairs = _split(fiber_set, stretch)
        assert hairs[..., 0].min() >= -1e-5
        assert hairs[..., 0].max() <= 5 + 1e-5


def test_perturbed_radii_stay_in_range_and_join_on_closed_yarns(fiber_config, yarn_loop) -> None:
    values = {"fuzz": 0.0, "fiber_count_scale": 0.2, "segment_mm": 0.05}
    yarns = yarn_loop(4.0)
    plain = run(fiber_config("rayon2", **values), yarns)
    rough = run(fiber_config("rayon2", perturbation=0.125, **values), yarns)
    ends = [_split(rough, j)[0] for j in (0, rough.stretch_count - 1)]
    assert (ends[0][:, 0] == ends[1][:, -1]).all()
    own = rough.seats["radius"][:, None]
    long = float(rough.yarns["ellipse_long"][0])
    for stretch in (2, rough.stretch_count - 1):
        moved = _split(rough, stretch)[0] - _split(plain, stretch)[0]
        distance = np.linalg.norm(moved, axis=-1)
        assert 0.3 < (distance / (own * long)).max() / 0.125 <= 1.0 + 1e-4
        steps = np.linalg.norm(np.diff(moved, axis=1), axis=-1)
        assert steps.max() < 0.4 * distance.max()  # smooth: no jump from node to node


def test_a_stretch_made_alone_has_the_same_bits(fiber_config, yarn_loop) -> None:
    fiber_set = run(fiber_config("cotton2", fuzz=3.0, fiber_count_scale=2.0), yarn_loop(5.0))
    together = strand_points(fiber_set, np.arange(fiber_set.stretch_count))
    for stretch in reversed(range(fiber_set.stretch_count)):
        alone = strand_points(fiber_set, np.array([stretch]))
        part = slice(together.offsets[stretch], together.offsets[stretch + 1])
        assert (alone.points.view(np.uint32) == together.points[part].view(np.uint32)).all()
        assert (alone.kind == together.kind[part]).all()


def test_the_same_yarn_made_again_has_the_same_bits(fiber_config, straight_yarn) -> None:
    """Yarn 0 does not change when other yarns join; another seed changes everything."""
    config = fiber_config("cotton2", fiber_count_scale=1.0)
    one, two = (run(config, straight_yarn(8.0, count=count)) for count in (1, 2))
    other = run(config.model_copy(update={"seed": 1}), straight_yarn(8.0))
    points = [strand_points(s, np.arange(one.stretch_count)).points for s in (one, two, other)]
    assert (points[0] == points[1]).all()
    same = min(len(points[0]), len(points[2]))
    assert (points[0][:same, 1:] != points[2][:same, 1:]).mean() > 0.99


def test_consecutive_stretches_share_their_points(fiber_config, yarn_loop) -> None:
    fiber_set = run(fiber_config("polyester1", fuzz=3.0, perturbation=0.1), yarn_loop(5.0))
    bodies = [_split(fiber_set, stretch)[0] for stretch in range(fiber_set.stretch_count)]
    for before, after in zip(bodies, bodies[1:] + bodies[:1], strict=True):  # the loop closes on itself
        assert (before[:, -1].view(np.uint32) == after[:, 0].view(np.uint32)).all()


def test_opened_strands_give_the_same_points(fiber_config, straight_yarn) -> None:
    fiber_set = run(fiber_config("cotton1", fiber_count_scale=0.5), straight_yarn(5.0))
    strands, nodes = int(fiber_set.stretch_strand_counts()[0]), fiber_set.config.hair_segments + 1
    points = wp.empty((2, strands, nodes), dtype=wp.vec3, device="cpu")
    wp.launch(_both_ways, (strands, nodes), inputs=[fiber_set.tables(), 0, points], device="cpu")
    first, second = points.numpy()
    assert (first == second).all()


def test_offsets_never_reach_the_center_of_curvature() -> None:
    bend = np.array([0.0, 2.0, 0.0])
    offsets = np.zeros((1000, 3), dtype=np.float32)
    offsets[:, 0], offsets[:, 1] = 0.7, np.linspace(-2, 2, 1000)
    kept = wp.empty(1000, dtype=wp.vec3, device="cpu")
    wp.launch(
        _squeezed,
        1000,
        inputs=[wp.array(offsets, dtype=wp.vec3, device="cpu"), wp.vec3(*bend), kept],
        device="cpu",
    )
    kept = kept.numpy()
    free = offsets @ bend <= 0.8
    assert (kept[free] == offsets[free]).all()
    assert (kept @ bend).max() <= 0.95 + 1e-6
    assert (np.diff(kept[:, 1]) > -1e-6).all()
    assert (kept[:, [0, 2]] == offsets[:, [0, 2]]).all()


def test_uniforms_equal_numpy_at_the_edges() -> None:
    words = np.array([0, 511, 512, 2**32 - 1], dtype=np.uint32)
    assert (uniform_single(words) > 0).all()
    assert (uniform_single(words) < 1).all()
    assert counter_random.uniform(words).max() < 1
