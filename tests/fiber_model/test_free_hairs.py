"""Hairs that wander or hang down: counts, lengths, directions, shapes, and the Warp twins."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from weft.fiber_model.counter_random import PURPOSE_DROOP, PURPOSE_WALK, seed_key
from weft.fiber_model.fiber_curves import strand_points
from weft.fiber_model.fibers import FiberSet, run
from weft.fiber_model.free_hairs import (
    FreeHairShape,
    droop_points,
    leaving_direction,
    sample_free_hairs,
    scaled_free_hairs,
    walk_points,
)

COUNT = 40_000
WALK = {"density_per_mm": 3.0, "length_mm": 2.0, "length_sd_mm": 0.4, "persistence_mm": 0.8}
DROOP = {"density_per_mm": 2.0, "length_mm": 3.0, "length_sd_mm": 0.5, "bend_mm": 1.0}
BARE = {"hair_density_per_mm": 0.0, "loop_density_per_mm": 0.0, "fiber_count_scale": 0.05}


def _hairs(fiber_set: FiberSet) -> np.ndarray:
    """Points of all hairs, shape [hair_count, points, 3]."""
    made = strand_points(fiber_set, np.arange(fiber_set.stretch_count))
    return made.points[made.kind == 2].reshape(-1, fiber_set.config.hair_segments + 1, 3).astype(np.float64)


def _lengths(hairs: np.ndarray) -> np.ndarray:
    return np.linalg.norm(np.diff(hairs, axis=1), axis=-1).sum(axis=1)


@pytest.mark.parametrize(("kind", "values"), [("walk_hairs", WALK), ("droop_hairs", DROOP)])
def test_free_hairs_are_as_many_and_as_long_as_asked_for(kind, values, fiber_config, straight_yarn) -> None:
    """Counts within 3 sqrt(rho L); lengths within 4 standard errors, chords of droops 0.1 % shorter."""
    config = fiber_config("cotton1", hair_segments=32, **BARE, **{kind: values})
    hairs = _hairs(run(config, straight_yarn(300.0)))
    expected = 3 * values["density_per_mm"] * 300.0
    assert abs(len(hairs) - expected) < 3 * np.sqrt(expected)
    length = _lengths(hairs)
    sd = values["length_sd_mm"]
    assert abs(length.mean() - values["length_mm"]) < 4 * sd / np.sqrt(len(length)) + 2e-3
    assert abs(length.std() / sd - 1) < 4 / np.sqrt(2 * len(length))


def test_fuzz_scales_number_and_length_of_free_hairs(fiber_config) -> None:
    plain, fuzzy, many = (
        scaled_free_hairs(fiber_config("cotton1", walk_hairs=WALK, droop_hairs=DROOP, **v))
        for v in ({}, {"fuzz": 3.0}, {"fuzz": 3.0, "fuzz_length": 1.0})
    )
    for name in ("walk", "droop"):
        number, length = (
            [getattr(shape, f"{name}_{what}") for shape in (plain, fuzzy, many)]
            for what in ("density", "length")
        )
        assert number == pytest.approx([number[0], 3 * number[0], 3 * number[0]])
        assert length[1] == pytest.approx([3 * v for v in length[0]])
        assert length[2] == length[0]
    assert scaled_free_hairs(fiber_config("cotton1", walk_hairs=WALK, fuzz=0.0)).walk_density == 0


def test_zhaos_hairs_stay_when_free_hairs_join(fiber_config, straight_yarn) -> None:
    plain, both = (
        run(fiber_config("cotton1", fiber_count_scale=0.05, **v), straight_yarn(20.0))
        for v in ({}, {"walk_hairs": WALK, "droop_hairs": DROOP})
    )
    points = hairs = 0
    for stretch in range(plain.stretch_count):
        first, second = (strand_points(s, np.array([stretch])).points for s in (plain, both))
        assert (first == second[: len(first)]).all()
        points, hairs = points + len(first), hairs + len(second) - len(first)
    assert hairs > 0


def test_directions_have_the_density_of_a_cosine() -> None:
    """cos^2 of the angle to the way out is uniform (Lambert); the root's place and ply are uniform."""
    hair = np.arange(COUNT)
    drawn = sample_free_hairs(PURPOSE_WALK, 7, 1, hair // 40, hair % 40, 3, (2.0, 0.4))
    outward = np.broadcast_to([0.6, 0.0, 0.8], (COUNT, 3))
    direction = leaving_direction(outward, drawn.toward.astype(np.float64))
    assert np.linalg.norm(direction, axis=1) == pytest.approx(1)
    assert stats.kstest((direction * outward).sum(axis=1) ** 2, "uniform").pvalue > 1e-4
    for values in (drawn.start, drawn.angle):
        assert stats.kstest(values, "uniform").pvalue > 1e-4
    assert np.abs(np.bincount(drawn.ply) / COUNT - 1 / 3).max() < 0.01
    assert stats.kstest((drawn.length - 2.0) / 0.4, "norm").pvalue > 1e-4


def test_hairs_made_in_warp_leave_their_ply_like_lambert(fiber_config, straight_yarn) -> None:
    """One round ply, straight hairs: the way out of the ply is the way out of the yarn."""
    config = fiber_config(
        "cotton1", **BARE, plies=1, ply_center_radius_mm=0.0, ellipse_long_mm=0.1, ellipse_short_mm=0.1,
        scale="as_fitted", walk_hairs={**WALK, "persistence_mm": 1e6},
    )  # fmt: skip
    hairs = _hairs(run(config, straight_yarn(3000.0, 0.1)))
    outward = hairs[:, 0] * [0.0, 1.0, 1.0]
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    way = hairs[:, -1] - hairs[:, 0]
    cosine = (way * outward).sum(axis=1) / np.linalg.norm(way, axis=1)
    assert len(hairs) > 8000
    assert stats.kstest(cosine**2, "uniform").pvalue > 1e-4
    assert cosine.min() > -1e-3


@pytest.mark.parametrize("step", [0.1, 1.0, 3.0])
def test_a_walk_forgets_its_direction_exponentially(step: float) -> None:
    """Mean cosine between steps k apart: exp(-k step / persistence), for fine and coarse steps alike."""
    hair = np.arange(COUNT)
    direction = np.tile([0.0, 0.6, 0.8], (COUNT, 1))
    points = walk_points(
        7, 1, hair // 40, hair % 40, np.zeros((COUNT, 3)), direction, np.full(COUNT, 6 * step),
        persistence=2.0, segments=6,
    )  # fmt: skip
    steps = np.diff(points, axis=1) / step
    assert np.linalg.norm(steps, axis=-1) == pytest.approx(1)
    for k in range(1, 6):
        cosine = (steps[:, 0] * steps[:, k]).sum(axis=1)
        assert abs(cosine.mean() - np.exp(-k * step / 2.0)) < 4 * cosine.std() / np.sqrt(COUNT)
    # no preferred side: the mean direction stays along the first step
    sideways = steps[:, 3].mean(axis=0) - np.exp(-3 * step / 2.0) * direction[0]
    assert np.abs(sideways).max() < 4 / np.sqrt(COUNT)


def test_a_droop_turns_down_as_its_equation_says() -> None:
    """dp/ds = -sin p / bend, by finite differences; unit speed; straight up and down are no trouble."""
    angle = np.array([1e-7, 0.3, 1.5, 3.0, np.pi])
    direction = np.stack([np.sin(angle), -np.cos(angle), 0 * angle], axis=1)
    shape = FreeHairShape(0, (0, 0), 1, 0, (0, 0), 2.0, (0.0, -1.0, 0.0))
    points = droop_points(np.zeros((5, 3)), direction, np.full(5, 8.0), shape, segments=4000)
    step = np.diff(points, axis=1)
    assert np.linalg.norm(step, axis=-1) == pytest.approx(8.0 / 4000, rel=1e-5)
    unit = step / np.linalg.norm(step, axis=-1, keepdims=True)
    assert unit[:4, 0] == pytest.approx(direction[:4], abs=2e-3)
    p = np.arctan2(unit[..., 0], -unit[..., 1])
    middle = 0.5 * (p[:, 1:] + p[:, :-1])
    assert np.diff(p, axis=1) / (8.0 / 4000) == pytest.approx(-np.sin(middle) / 2.0, abs=1e-5)
    assert (np.diff(unit[:, :, 1], axis=1) < 1e-9).all()  # only ever turns down
    assert np.isfinite(points).all()


def test_drooping_hairs_hang_along_down(fiber_config, straight_yarn) -> None:
    for down in ((0.0, -1.0, 0.0), (0.0, 0.0, 5.0)):
        config = fiber_config("cotton1", **BARE, droop_hairs={**DROOP, "bend_mm": 0.2, "down": down})
        hairs = _hairs(run(config, straight_yarn(40.0)))
        last = hairs[:, -1] - hairs[:, -2]
        last /= np.linalg.norm(last, axis=1, keepdims=True)
        assert np.percentile(last @ (np.array(down) / np.linalg.norm(down)), 1) > 0.99


def _walks_and_droops(fiber_set: FiberSet, stretch: int) -> tuple[np.ndarray, np.ndarray]:
    made = strand_points(fiber_set, np.array([stretch]))
    hairs = made.points[made.kind == 2].reshape(-1, fiber_set.config.hair_segments + 1, 3).astype(np.float64)
    return np.split(hairs, [int(fiber_set.stretches["walks"][stretch])])


@pytest.mark.parametrize("closed", [False, True])
def test_warp_makes_the_hairs_that_numpy_makes(closed, fiber_config, straight_yarn, yarn_loop) -> None:
    """Roots and directions are taken from the same hairs made straight."""
    yarns = yarn_loop(3.0, 0.4) if closed else straight_yarn(12.0, 0.4)
    config, straight = (
        fiber_config(
            "cotton1", **BARE, cords=2,
            walk_hairs={**WALK, "persistence_mm": p}, droop_hairs={**DROOP, "bend_mm": b},
        )
        for p, b in ((0.8, 1.0), (1e6, 1e3))
    )  # fmt: skip
    fiber_set, as_sticks = run(config, yarns), run(straight, yarns)
    seed, shape = seed_key(config.seed), scaled_free_hairs(config)
    for stretch in (0, fiber_set.stretch_count - 1):
        for purpose, part, sticks, length in zip(
            (PURPOSE_WALK, PURPOSE_DROOP),
            _walks_and_droops(fiber_set, stretch),
            _walks_and_droops(as_sticks, stretch),
            (shape.walk_length, shape.droop_length),
            strict=True,
        ):
            hair, number = np.arange(len(part)), np.full(len(part), stretch)
            drawn = sample_free_hairs(purpose, seed, 0, number, hair, 6, length).length
            way = sticks[:, 1] - sticks[:, 0] if purpose == PURPOSE_WALK else sticks[:, -1] - sticks[:, 0]
            direction = way / np.linalg.norm(way, axis=1, keepdims=True)
            if purpose == PURPOSE_WALK:
                expected = walk_points(
                    seed, 0, number, hair, sticks[:, 0], direction, drawn,
                    persistence=shape.persistence, segments=config.hair_segments,
                )  # fmt: skip
            else:
                expected = droop_points(sticks[:, 0], direction, drawn, shape, segments=config.hair_segments)
            assert len(part) > 1
            # a stick of 1 m still droops by length / 2000
            assert np.abs(part - expected).max() < (1e-4 if purpose == PURPOSE_WALK else 1e-2)


def test_free_hairs_begin_inside_their_ply_and_stay_in_the_box_of_their_stretch(
    fiber_config, yarn_loop
) -> None:
    config = fiber_config("cotton1", **BARE, walk_hairs=WALK, droop_hairs=DROOP, cords=3, fuzz=2.0)
    fiber_set = run(config, yarn_loop(6.0, 0.5))
    bounds = fiber_set.stretch_bounds()
    center = fiber_set.nodes["position"].astype(np.float64)
    for stretch in range(fiber_set.stretch_count):
        made = strand_points(fiber_set, np.array([stretch]))
        assert (made.points >= bounds[stretch, 0]).all()
        assert (made.points <= bounds[stretch, 1]).all()
        root = made.points[made.kind == 2].reshape(-1, config.hair_segments + 1, 3)[:, 0]
        distance = np.linalg.norm(root[:, None] - center[None], axis=-1).min(axis=1)
        assert (distance < 0.5).all()


def test_lengths_count_free_hairs(fiber_config, straight_yarn) -> None:
    config = fiber_config("cotton1", **BARE, walk_hairs=WALK, droop_hairs=DROOP)
    fiber_set = run(config, straight_yarn(20.0))
    assert fiber_set.fiber_lengths_mm()[:, 1].sum() == pytest.approx(
        _lengths(_hairs(fiber_set)).sum(), rel=1e-9
    )
