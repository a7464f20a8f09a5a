"""The hierarchy holds every triangle once, and its threads visit whatever a ray can meet."""

from __future__ import annotations

import numpy as np
import pytest

from weft.renderer.bvh import DIRECTIONS, END, LEAF_TRIANGLES, Bvh, build_bvh


def random_boxes(count, seed=1):
    rng = np.random.default_rng(seed)
    lower = rng.normal(size=(count, 3)) * [3, 1, 5]
    return lower, lower + rng.random((count, 3)) ** 4


def walk(bvh: Bvh, direction: int, hit) -> list[int]:
    """Nodes in the order of their threads; `hit(node)` says whether the box is met."""
    nodes, node = [], 0
    while node != END:
        nodes.append(node)
        node = int(bvh.links[node, direction, 0 if hit(node) else 1])
        assert len(nodes) <= len(bvh.first)
    return nodes


@pytest.mark.parametrize("count", [1, 2, 3, 7, 1000])
def test_every_triangle_is_in_one_leaf_and_inside_of_its_box(count):
    lower, upper = random_boxes(count)
    bvh = build_bvh(lower, upper)
    leaves = bvh.count > 0
    assert bvh.count.max() <= LEAF_TRIANGLES
    places = np.concatenate([np.arange(f, f + n) for f, n in zip(bvh.first, bvh.count, strict=True)])
    np.testing.assert_array_equal(np.sort(places), np.arange(count))
    np.testing.assert_array_equal(np.sort(bvh.order), np.arange(count))
    for node in np.flatnonzero(leaves):
        inside = bvh.order[bvh.first[node] : bvh.first[node] + bvh.count[node]]
        np.testing.assert_array_equal(bvh.lower[node], lower[inside].min(axis=0))
        np.testing.assert_array_equal(bvh.upper[node], upper[inside].max(axis=0))


@pytest.mark.parametrize("direction", range(DIRECTIONS))
def test_threads_visit_every_node_once_where_all_boxes_are_hit(direction):
    bvh = build_bvh(*random_boxes(500))
    assert sorted(walk(bvh, direction, lambda node: True)) == list(range(len(bvh.first)))
    assert walk(bvh, direction, lambda node: False) == [0]


@pytest.mark.parametrize("direction", range(DIRECTIONS))
def test_a_walk_meets_the_same_triangles_as_a_search_through_all(direction):
    lower, upper = random_boxes(400, seed=2)
    bvh = build_bvh(lower, upper)
    axis, sign = direction // 2, 1 - 2 * (direction % 2)
    across = [i for i in range(3) if i != axis]
    for point in np.random.default_rng(3).normal(size=(20, 3)) * [3, 1, 5]:

        def covers(low, high, point=point):
            return ((low[..., across] <= point[across]) & (point[across] <= high[..., across])).all(-1)

        nodes = walk(bvh, direction, lambda node, covers=covers: covers(bvh.lower[node], bvh.upper[node]))
        met = [
            i
            for node in nodes
            if covers(bvh.lower[node], bvh.upper[node])
            for i in bvh.order[bvh.first[node] : bvh.first[node] + bvh.count[node]]
            if covers(lower[i], upper[i])
        ]
        assert sorted(met) == np.flatnonzero(covers(lower, upper)).tolist()
        if len(met) > 4:  # near boxes come first, on the whole
            middles = sign * (lower + upper)[met, axis]
            assert np.corrcoef(middles, np.arange(len(met)))[0, 1] > 0


def test_triangles_in_one_place_are_halved():
    bvh = build_bvh(np.zeros((9, 3)), np.ones((9, 3)))
    assert bvh.count.sum() == 9
    assert len(bvh.first) < 18


def test_boxes_cost_less_than_halves_by_order():
    """The expected number of boxes that a random ray meets is far below that of halving by order."""
    lower, upper = random_boxes(2000, seed=4)
    bvh = build_bvh(lower, upper)
    size = bvh.upper - bvh.lower
    area = (size * np.roll(size, 1, axis=1)).sum(axis=1)
    assert (area / area[0]).sum() < 60
