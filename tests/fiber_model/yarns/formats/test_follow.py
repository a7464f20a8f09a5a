"""Curves of other kinds become Catmull-Rom curves within the stated tolerance."""

import numpy as np
import pytest

from weft.fiber_model.yarns.catmull_rom import CatmullRom
from weft.fiber_model.yarns.formats.follow import BASES, TOLERANCE, follow_curves
from weft.fiber_model.yarns.yarns import YarnSet
from weft.files.errors import InputError

RADIUS = 0.3


def smooth_walk(count, seed):
    """Points about 1 mm apart on a curve that bends at random."""
    rng = np.random.default_rng(seed)
    heading = np.cumsum(rng.normal(size=(count, 2)) * 0.3, axis=0)
    steps = np.stack([np.cos(heading[:, 0]), np.sin(heading[:, 0]), 0.4 * np.sin(heading[:, 1])], axis=1)
    return np.cumsum(steps, axis=0)


def pieces(points, basis, *, step=1, closed=False):
    """Coefficients of the segments of one curve."""
    count = len(points) // step if closed else (len(points) - 4) // step + 1
    index = np.arange(count)[:, None] * step + np.arange(4)
    return np.einsum("pk,skx->spx", BASES[basis], points[index % len(points)])


def smooth_bezier(points):
    """Bezier points through `points` whose handles differ in length before and after each joint."""
    tangent = np.gradient(points, axis=0)
    return np.concatenate(
        [
            [points[k], points[k] + 0.2 * tangent[k], points[k + 1] - 0.45 * tangent[k + 1]]
            for k in range(len(points) - 1)
        ]
        + [points[-1:]]
    )


def dense(coefficients, count):
    curve = CatmullRom(coefficients, np.array([0, len(coefficients)]))
    segment = np.append(np.repeat(np.arange(len(coefficients)), count), len(coefficients) - 1)
    return curve.position(segment, np.append(np.tile(np.arange(count) / count, len(coefficients)), 1.0))


def distance_to_polyline(points, line):
    """Distance of each point from the polyline."""
    start, edge = line[:-1], np.diff(line, axis=0)
    best = np.full(len(points), np.inf)
    for a, e in zip(start, edge, strict=True):
        square = max(e @ e, 1e-30)
        t = np.clip((points - a) @ e / square, 0, 1)
        best = np.minimum(best, np.linalg.norm(points - a - t[:, None] * e, axis=1))
    return best


@pytest.mark.parametrize(
    ("basis", "closed"), [("bspline", False), ("bspline", True), ("bezier", False), ("catmullRom", False)]
)
def test_both_curves_stay_within_the_tolerance_of_each_other(basis, closed):
    points = smooth_walk(14, 3)
    if closed:
        angle = np.arange(14) * 2 * np.pi / 14
        points = np.stack([3 * np.cos(angle), 2 * np.sin(angle), 0.5 * np.sin(3 * angle)], axis=1)
    if basis == "bezier":
        coefficients = pieces(smooth_bezier(points), "bezier", step=3)
    else:
        coefficients = pieces(points, basis, closed=closed)
    given = CatmullRom(coefficients, np.array([0, len(coefficients)]))
    (controls,) = follow_curves(given, np.array([closed]), np.array([RADIUS]))
    yarns = YarnSet.checked([controls], closed=closed, radius=RADIUS)
    made = dense(CatmullRom.through(yarns).coefficients, 24)
    wanted = dense(coefficients, 96)
    assert len(controls) < 12 * len(coefficients)
    assert distance_to_polyline(made, wanted).max() < TOLERANCE * RADIUS
    assert distance_to_polyline(wanted[::4], made).max() < TOLERANCE * RADIUS + 5e-4


def test_a_catmull_rom_curve_keeps_its_points():
    points = smooth_walk(9, 4)
    with_guides = np.concatenate([[2 * points[0] - points[1]], points, [2 * points[-1] - points[-2]]])
    coefficients = pieces(with_guides, "catmullRom")
    given = CatmullRom(coefficients, np.array([0, len(coefficients)]))
    (controls,) = follow_curves(given, np.array([False]), np.array([RADIUS]))
    assert controls == pytest.approx(points, abs=1e-12)


def test_curves_do_not_depend_on_their_neighbors():
    parts = [pieces(smooth_walk(n, n), "bspline") for n in (5, 40, 9)]
    together = CatmullRom(np.concatenate(parts), np.cumsum([0] + [len(part) for part in parts]))
    joined = follow_curves(together, np.zeros(3, bool), np.full(3, RADIUS))
    for part, controls in zip(parts, joined, strict=True):
        alone = CatmullRom(part, np.array([0, len(part)]))
        assert np.array_equal(follow_curves(alone, np.zeros(1, bool), np.full(1, RADIUS))[0], controls)


@pytest.mark.parametrize(
    ("spoil", "radius", "message"),
    [
        (lambda c: c * np.nan, 1.0, "yarn 0 is not finite or reaches beyond ten kilometers"),
        (lambda c: c * 1e12, 1.0, "yarn 0 is not finite or reaches beyond ten kilometers"),
        (lambda c: c * 0.0, 1.0, "yarn 0 has no length"),
        (lambda c: c, 0.0, "yarn 0 has radius 0 mm"),
        (lambda c: c, 1e-9, "yarn 0 bends too sharply to be followed to within 0.01 yarn radii"),
    ],
)
def test_what_cannot_be_followed_is_refused(spoil, radius, message):
    coefficients = spoil(pieces(smooth_walk(8, 1), "bspline"))
    given = CatmullRom(coefficients, np.array([0, len(coefficients)]))
    with pytest.raises(InputError, match=message):
        follow_curves(given, np.array([False]), np.array([radius]))
