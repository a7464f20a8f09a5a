"""Periodic tiles: yarns run unbroken, cover their periods, and are cut at the border."""

import numpy as np
import pytest

from weft.fiber_model.yarns.catmull_rom import yarn_lengths
from weft.fiber_model.yarns.fabrics.cut import cut_to_rectangle
from weft.fiber_model.yarns.fabrics.tile import PeriodicTile, follow_chains, repeat_tile, tile_yarns
from weft.fiber_model.yarns.formats.pyp import read_pyp
from weft.fiber_model.yarns.frames import build_frames
from weft.fiber_model.yarns.yarns import YarnSet

PATTERNS = ("stockinette", "stockinette_small", "basket", "satin", "satin_small")


def pattern(shared_data, name: str) -> PeriodicTile:
    return read_pyp(shared_data / "yarn_patterns" / f"{name}.pyp")


def chords(yarns: YarnSet) -> np.ndarray:
    return np.concatenate(
        [np.linalg.norm(np.diff(yarns.yarn(y), axis=0), axis=1) for y in range(yarns.yarn_count)]
    )


def made_tile(points, next_vertex, next_step, *, period=(10.0, 10.0)) -> PeriodicTile:
    return PeriodicTile(
        period=np.array(period),
        radius=0.5,
        points=np.array(points, dtype=float),
        next_vertex=np.array(next_vertex),
        next_step=np.array(next_step),
    )


STRAIGHT = made_tile(
    [[0, 0, 0], [2.5, 1, 0], [5, 0, 1], [7.5, -1, 0]], [1, 2, 3, 0], [[0, 0], [0, 0], [0, 0], [1, 0]]
)


@pytest.mark.parametrize("name", PATTERNS)
def test_tiling_is_continuous_and_complete(shared_data, name):
    """No gaps, every vertex in every tile, and the length that the file says at rest."""
    tile = pattern(shared_data, name)
    yarns, _ = repeat_tile(tile, (3, 4))
    spacing = chords(yarns)
    assert spacing.max() < 1.6 * np.median(spacing)
    assert tile.rest_length is not None
    assert spacing.sum() == pytest.approx(12 * tile.rest_length.sum(), rel=0.01)
    # heights out of the fabric tell the vertices apart: each occurs in every tile, the first ones once more
    copies = [(np.abs(yarns.points[:, 2] - height) < 1e-12).sum() for height in tile.points[:, 2]]
    assert min(copies) >= 12
    assert yarns.point_count == 12 * len(tile.points) + yarns.yarn_count


@pytest.mark.parametrize("name", PATTERNS)
def test_cut_cloth_fills_its_rectangle(shared_data, name):
    tile = pattern(shared_data, name)
    size = 4.5 * tile.period
    cut = tile_yarns(tile, (float(size[0]), float(size[1])))
    area_share = yarn_lengths(cut).sum() / (20.25 * tile.rest_length.sum())
    assert area_share == pytest.approx(1, abs=0.06)
    assert np.abs(cut.points[:, 0]).max() == pytest.approx(size[0] / 2, rel=1e-9)
    # an end may be half a chord longer than the others
    assert chords(cut).max() < 2.1 * np.median(chords(cut))


def test_twist_follows_the_material_of_the_simulation(shared_data):
    """Frames turned by the twist pass through the directors that the file stores."""
    tile = pattern(shared_data, "stockinette")
    yarns, _ = repeat_tile(tile, (2, 1))
    fine = build_frames(yarns, max_step_mm=0.02)
    edge = tile.edge_vectors()
    axis = edge / np.linalg.norm(edge, axis=1)[:, None]
    angle = tile.twist[:, None]
    material = np.cos(angle) * tile.director + np.sin(angle) * np.cross(axis, tile.director)
    for yarn in range(yarns.yarn_count):
        samples = fine.position[fine.offsets[yarn] : fine.offsets[yarn + 1]]
        for point in yarns.yarn(yarn)[5:60]:
            vertex = int(np.argmin(np.abs(tile.points[:, 2] - point[2])))
            before = int(np.flatnonzero(tile.next_vertex == vertex)[0])
            expected = material[vertex] + material[before]
            at = fine.offsets[yarn] + int(np.argmin(np.linalg.norm(samples - point, axis=1)))
            expected -= expected @ fine.tangent[at] * fine.tangent[at]
            assert fine.normal[at] @ expected / np.linalg.norm(expected) > np.cos(0.06)


def test_yarns_cross_tile_borders_unbroken():
    yarns, translation = repeat_tile(STRAIGHT, (3, 2))
    assert yarns.yarn_count == 2
    assert translation.tolist() == [[1, 0], [1, 0]]
    assert np.diff(yarns.yarn(0)[:, 0]) == pytest.approx(np.full(12, 2.5))


def test_loops_of_a_tile_stay_closed():
    """A ring that leaves the tile on the right and comes back in is one loop per tile."""
    ring = made_tile(
        [[8, 0, 0], [-1, 2, 0], [-2, 0, 0], [9, -2, 0]],
        [1, 2, 3, 0],
        [[1, 0], [0, 0], [-1, 0], [0, 0]],
    )
    yarns, _ = repeat_tile(ring, (2, 3))
    assert yarns.yarn_count == 6
    assert yarns.closed.all()
    assert np.ptp(yarns.yarn(0), axis=0) == pytest.approx([1.0, 4.0, 0.0])
    frames = build_frames(yarns)
    assert np.array_equal(frames.normal[frames.offsets[:-1]], frames.normal[frames.offsets[1:] - 1])


def test_diagonal_yarns_cover_every_tile_once():
    steps = [[0, 0], [0, 0], [0, 0], [1, 1]]
    diagonal = made_tile([[0, 0, 0], [2.5, 2.5, 0], [5, 5, 0], [7.5, 7.5, 0]], [1, 2, 3, 0], steps)
    yarns, _ = repeat_tile(diagonal, (3, 4))
    assert yarns.yarn_count == 3 + 4 - 1
    assert yarns.point_count == 12 * 4 + yarns.yarn_count
    inside = tile_yarns(diagonal, (20.0, 20.0))
    assert np.abs(inside.points[:, :2]).max() == pytest.approx(10.0, rel=1e-9)


def test_yarns_that_end_within_the_tile_end():
    stub = made_tile(
        [[1, 0, 0], [3, 0, 0], [5, 1, 0], [7, 1, 0]], [1, 2, 3, -1], [[0, 0], [0, 0], [0, 0], [0, 0]]
    )
    (chain,) = follow_chains(stub)
    assert chain.open
    yarns, _ = repeat_tile(stub, (2, 2))
    assert yarns.point_counts.tolist() == [4, 4, 4, 4]
    assert not yarns.closed.any()


def test_cut_ends_lie_on_the_border():
    x = np.linspace(-10, 10, 41)
    wave = np.stack([x, 4 * np.sin(x), 0 * x], axis=1)
    yarns = YarnSet.checked([wave], radius=0.1, twist=[x], surface_uv=[wave[:, :2]])
    cut = cut_to_rectangle(yarns, (15.0, 6.0))
    assert cut is not None
    assert (np.abs(cut.points[:, 0]) <= 7.5 + 1e-9).all()
    assert (np.abs(cut.points[:, 1]) <= 3.0 + 1e-9).all()
    ends = np.concatenate([cut.points[cut.offsets[:-1]], cut.points[cut.offsets[1:] - 1]])
    on_border = np.isclose(np.abs(ends[:, 0]), 7.5) | np.isclose(np.abs(ends[:, 1]), 3.0)
    assert on_border.all()
    assert cut.twist == pytest.approx(cut.points[:, 0], abs=0.02)
    assert cut.surface_uv == pytest.approx(cut.points[:, :2], abs=0.3)


def test_nothing_left_is_none():
    x = np.linspace(100, 110, 10)
    assert cut_to_rectangle(YarnSet.checked([np.stack([x, x, x], axis=1)], radius=1.0), (5.0, 5.0)) is None
