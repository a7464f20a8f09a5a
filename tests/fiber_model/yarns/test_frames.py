"""Frames along yarns: uniform arc length, orthonormal, rotation-minimizing, closed where the yarn is."""

import numpy as np
import pytest

from weft.fiber_model.yarns.catmull_rom import yarn_lengths
from weft.fiber_model.yarns.frames import YarnFrames, build_frames
from weft.fiber_model.yarns.yarns import YarnSet

TURN = 2 * np.pi


def circle(radius: float, count: int) -> np.ndarray:
    t = np.arange(count) / count * TURN
    return np.stack([radius * np.cos(t), radius * np.sin(t), 0 * t], axis=1)


def helix(radius: float, pitch: float, turns: float, count: int) -> np.ndarray:
    t = np.linspace(0, turns * TURN, count)
    return np.stack([radius * np.cos(t), radius * np.sin(t), pitch * t / TURN], axis=1)


def trefoil(count: int) -> np.ndarray:
    """A knot whose frame does not close by itself."""
    t = np.arange(count) / count * TURN
    x, y = np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t)
    return 4 * np.stack([x, y, -np.sin(3 * t)], axis=1)


def wandering(count: int, seed: int) -> np.ndarray:
    steps = np.random.default_rng(seed).normal(size=(count, 3)) * 0.6 + [1.0, 0.0, 0.0]
    return np.cumsum(steps, axis=0)


def part(frames: YarnFrames, yarn: int) -> slice:
    return slice(frames.offsets[yarn], frames.offsets[yarn + 1])


@pytest.fixture(scope="module")
def mixed() -> tuple[YarnSet, YarnFrames]:
    yarns = YarnSet.checked(
        [trefoil(60), helix(3, 5, 3, 200), wandering(50, 1), circle(5, 32), trefoil(41)],
        closed=[True, False, False, True, True],
        radius=[0.4, 0.5, 0.2, 0.3, 0.2],
    )
    return yarns, build_frames(yarns)


def test_arc_length_of_circle_and_helix():
    yarns = YarnSet.checked([circle(10, 256), helix(3, 5, 4, 512)], closed=[True, False], radius=0.5)
    frames = build_frames(yarns)
    helix_length = 4 * np.hypot(TURN * 3, 5)
    assert frames.length == pytest.approx([TURN * 10, helix_length], rel=2e-6)
    assert yarn_lengths(yarns) == pytest.approx(frames.length, rel=0, abs=0)
    middle = frames.curvature[part(frames, 1)][50:-50]
    assert middle == pytest.approx(np.full(len(middle), 3 / (3**2 + (5 / TURN) ** 2)), rel=2e-3)


def test_samples_lie_at_uniform_arc_length(mixed):
    """On a fine polyline of the same curve, from every sample to the next it is one step."""
    yarns, frames = mixed
    coarse = build_frames(yarns, max_step_mm=1.0)
    fine = build_frames(yarns, max_step_mm=1e-3)
    for yarn in range(yarns.yarn_count):
        assert coarse.step[yarn] * coarse.interval_counts[yarn] == pytest.approx(
            coarse.length[yarn], rel=1e-15
        )
        curve = fine.position[part(fine, yarn)]
        along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
        at = np.arange(coarse.interval_counts[yarn] + 1) * coarse.step[yarn]
        expected = np.stack([np.interp(at, along, curve[:, axis]) for axis in range(3)], axis=1)
        assert np.abs(coarse.position[part(coarse, yarn)] - expected).max() < 2e-5
    assert (frames.step <= 0.25 * yarns.radius).all()


def test_curve_passes_through_its_control_points(mixed):
    yarns, _ = mixed
    frames = build_frames(yarns, max_step_mm=2e-3)
    for yarn in range(yarns.yarn_count):
        samples = frames.position[part(frames, yarn)]
        for point in yarns.yarn(yarn):
            assert np.linalg.norm(samples - point, axis=1).min() < 1.1e-3


def test_frames_are_orthonormal(mixed):
    _, frames = mixed
    dot = np.einsum("ij,ij->i", frames.tangent, frames.normal)
    assert np.abs(dot).max() < 1e-14
    for vectors in (frames.tangent, frames.normal):
        assert np.linalg.norm(vectors, axis=1) == pytest.approx(np.ones(len(vectors)), abs=1e-14)


def test_frames_equal_stepwise_double_reflection():
    """Wang et al. 2008, table I, one sample after the other, as the paper writes it."""
    frames = build_frames(YarnSet.checked([wandering(60, 2)], radius=0.5))
    x, t = frames.position, frames.tangent
    normal = frames.normal[0]
    for i in range(len(x) - 1):
        v1 = x[i + 1] - x[i]
        r_l = normal - 2 / (v1 @ v1) * (v1 @ normal) * v1
        t_l = t[i] - 2 / (v1 @ v1) * (v1 @ t[i]) * v1
        v2 = t[i + 1] - t_l
        normal = r_l - 2 / (v2 @ v2) * (v2 @ r_l) * v2
        assert frames.normal[i + 1] == pytest.approx(normal, abs=1e-10)


def test_frames_do_not_turn_about_the_tangent():
    """Along a helix a rotation-minimizing frame turns against the Frenet frame by minus the torsion."""
    radius, pitch = 3.0, 5.0
    frames = build_frames(YarnSet.checked([helix(radius, pitch, 3, 3000)], radius=0.2))
    h = pitch / TURN
    torsion = h / (radius**2 + h**2)
    inner = slice(200, -200)
    toward_axis = -frames.position[inner] * [1, 1, 0] / radius
    binormal = np.cross(frames.tangent[inner], toward_axis)
    angle = np.unwrap(
        np.arctan2(
            np.einsum("ij,ij->i", frames.normal[inner], binormal),
            np.einsum("ij,ij->i", frames.normal[inner], toward_axis),
        )
    )
    slope = np.polyfit(frames.arc_length[inner], angle, 1)[0]
    assert slope == pytest.approx(-torsion, rel=1e-3)


def test_frames_of_loops_close(mixed):
    """At the end of a loop the frame is that of its beginning, and comes there without a jump."""
    yarns, frames = mixed
    for yarn in np.flatnonzero(yarns.closed):
        p = part(frames, yarn)
        for field in (frames.position, frames.tangent, frames.normal, frames.curvature):
            assert np.array_equal(field[p][0], field[p][-1])
        turning = np.linalg.norm(np.diff(frames.normal[p], axis=0), axis=1)
        assert turning[-1] < 2 * turning[-10:-1].max() + 1e-12


def test_twist_turns_the_frame_and_stays_closed():
    curve = trefoil(80)
    twist = 3 * TURN * np.arange(80) / 80
    plain = build_frames(YarnSet.checked([curve], closed=True, radius=0.5))
    twisted = build_frames(YarnSet.checked([curve], closed=True, radius=0.5, twist=[twist]))
    binormal = np.cross(plain.tangent, plain.normal)
    angle = np.unwrap(
        np.arctan2(
            np.einsum("ij,ij->i", twisted.normal, binormal),
            np.einsum("ij,ij->i", twisted.normal, plain.normal),
        )
    )
    assert angle[-1] == pytest.approx(3 * TURN, abs=1e-9)
    assert (np.diff(angle) > 0).all()
    assert np.array_equal(twisted.normal[0], twisted.normal[-1])


def test_frames_of_a_yarn_do_not_depend_on_its_neighbors(mixed):
    yarns, frames = mixed
    for yarn in range(yarns.yarn_count):
        alone = build_frames(
            YarnSet.checked([yarns.yarn(yarn)], closed=yarns.closed[yarn], radius=yarns.radius[yarn])
        )
        for field in ("position", "tangent", "normal", "curvature"):
            assert np.array_equal(getattr(alone, field), getattr(frames, field)[part(frames, yarn)])


def test_folds_are_counted():
    yarns = YarnSet.checked([circle(1.0, 64), circle(3.0, 64)], closed=True, radius=2.0)
    frames = build_frames(yarns)
    assert frames.folded_count(yarns.radius) == frames.offsets[1]


def test_repeated_control_points_leave_finite_frames():
    curve = np.repeat(np.array([[0.0, 0, 0], [1, 0, 0], [2, 1, 0], [3, 1, 1]]), 3, axis=0)
    frames = build_frames(YarnSet.checked([curve], radius=0.3))
    for field in (frames.position, frames.tangent, frames.normal, frames.curvature):
        assert np.isfinite(field).all()
    assert np.linalg.norm(frames.tangent, axis=1) == pytest.approx(np.ones(len(frames.tangent)))
