"""Nodes of yarns, laid in groups: the same bits as alone, in memory that is known to suffice."""

from __future__ import annotations

import numpy as np
import pytest

from weft.fiber_model import yarn_nodes
from weft.fiber_model.fibers import run
from weft.fiber_model.yarn_nodes import most_nodes
from weft.fiber_model.yarns.frames import build_frames
from weft.fiber_model.yarns.yarns import YarnSet


def _wild_yarns(seed: int, count: int) -> YarnSet:
    """Open and closed yarns through random points, so with long and short chords and sharp turns."""
    rng = np.random.default_rng(seed)
    curves = [rng.normal(size=(rng.integers(4, 40), 3)).cumsum(axis=0) for _ in range(count)]
    return YarnSet.checked(curves, closed=(rng.random(count) < 0.5).tolist(), radius=0.3)


@pytest.mark.parametrize("seed", range(5))
def test_no_yarn_has_more_nodes_than_foretold(seed) -> None:
    yarns = _wild_yarns(seed, 40)
    counts = build_frames(yarns, max_step_mm=0.01).interval_counts + 1
    most = most_nodes(yarns, 0.01)
    assert (counts <= most).all()
    assert most.sum() < 1.2 * counts.sum()


def test_a_straight_open_yarn_has_the_nodes_foretold(straight_yarn) -> None:
    yarns = straight_yarn(10.0)
    counts = build_frames(yarns, max_step_mm=0.01).interval_counts + 1
    assert counts[0] <= most_nodes(yarns, 0.01)[0] <= counts[0] + 1


@pytest.mark.parametrize("group_nodes", [1, 500, 1 << 17])
def test_groups_change_no_bit(group_nodes, fiber_config, monkeypatch) -> None:
    yarns = _wild_yarns(1, 12)
    config = fiber_config("cotton1", fiber_count_scale=0.1)
    whole = run(config, yarns)
    monkeypatch.setattr(yarn_nodes, "GROUP_NODES", group_nodes)
    grouped = run(config, yarns)
    assert grouped.nodes.tobytes() == whole.nodes.tobytes()
    assert grouped.yarns.tobytes() == whole.yarns.tobytes()
    assert grouped.report == whole.report


def test_boxes_hold_every_point(fiber_config) -> None:
    """Loops and hairs included."""
    from weft.fiber_model.fiber_curves import strand_points

    fibers = run(fiber_config("cotton1", fiber_count_scale=0.3, fuzz=2.0), _wild_yarns(3, 4))
    made = strand_points(fibers, np.arange(fibers.stretch_count))
    stretch = np.repeat(np.arange(fibers.stretch_count), np.diff(made.offsets))
    low, high = fibers.stretch_bounds()[stretch].transpose(1, 0, 2)
    assert (made.points >= low).all()
    assert (made.points <= high).all()
