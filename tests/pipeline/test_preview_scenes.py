"""What a preview shows, before it is drawn: the right part, bounded in size, and never silently."""

from __future__ import annotations

import dataclasses
from dataclasses import replace

import numpy as np
import pytest

from weft.fiber_model.config import FibersConfig
from weft.fiber_model.fiber_curves import FiberCurves, FiberSelection, export_curves, select_stretches
from weft.fiber_model.fibers import run as run_fibers
from weft.fiber_model.yarns.yarns import YarnSet
from weft.files.errors import InputError
from weft.pipeline.config import load
from weft.pipeline.preview import fiber_scene, grid_slice, part
from weft.pipeline.preview.framing import Panel, camera_axes, framed, needed_scale
from weft.pipeline.preview.grid_scene import grid_scene
from weft.pipeline.preview.options import SlicePlane, parse_box, parse_size, parse_slice
from weft.pipeline.preview.scale_bar import bar_length
from weft.pipeline.preview.scene import Axes, Slice, Surface, Tubes
from weft.pipeline.preview.yarn_scene import sampled_curves, yarn_scene
from weft.voxelize.grid import FiberGrid, FiberVolume


def circle(radius=5.0, count=12):
    angle = np.arange(count) / count * 2 * np.pi
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), 0 * angle], axis=1)


def straight(y=0.0, length=10.0):
    return np.stack([np.linspace(0, length, 8), np.full(8, y), np.zeros(8)], axis=1)


def curves(count=20, points=50):
    x = np.linspace(0, 10, points)
    made = [np.stack([x, np.full(points, 0.1 * i), 0.02 * np.sin(x)], axis=1) for i in range(count)]
    kind = np.zeros(count * points, np.uint8)
    kind[10:20] = 1
    kind[-points:] = 2
    ply = np.arange(count, dtype=np.int32) % 3
    ply[-1] = -1
    return FiberCurves(
        points=np.concatenate(made).astype(np.float32),
        kind=kind,
        offsets=np.arange(count + 1, dtype=np.int64) * points,
        ply=ply,
        yarn=np.zeros(count, np.int32),
        fiber_radius_mm=np.full(count, 0.01, np.float32),
    )


def volume(seed=3):
    """Two media with random voxels in scattered bricks."""
    rng = np.random.default_rng(seed)
    grids = {}
    for name, count in (("warp", 9), ("weft", 5)):
        places = rng.choice(4 * 4 * 3, count, replace=False)
        origins = np.stack(np.unravel_index(np.sort(places), (4, 4, 3)), axis=1).astype(np.int32) * 8 - 8
        density = (rng.random((count, 512)) * (rng.random((count, 512)) < 0.4)).astype(np.float32)
        direction = rng.normal(size=(count, 512, 3)).astype(np.float32)
        direction /= np.linalg.norm(direction, axis=2, keepdims=True)
        grids[name] = FiberGrid(0.5, 0.01, origins, density, direction * (density > 0)[..., None])
    return FiberVolume(grids)


def dense(grid, region):
    """The same by a plain loop over all voxels."""
    block = np.zeros(region.shape, np.float32)
    axes = np.zeros((*region.shape, 3), np.float32)
    for origin, density, direction in zip(grid.origins, grid.density, grid.direction, strict=True):
        for place in range(512):
            voxel = tuple(origin + np.unravel_index(place, (8, 8, 8)) - region.low)
            if all(0 <= i < n for i, n in zip(voxel, region.shape, strict=True)):
                block[voxel], axes[voxel] = density[place], direction[place]
    return block, axes


def drawn(scene):
    (tubes,) = scene.layers
    assert isinstance(tubes, Tubes)
    assert (np.diff(tubes.offsets) >= 2).all()
    assert len(tubes.radius) == tubes.curve_count
    assert len(tubes.color) == len(tubes.points) == tubes.offsets[-1]
    return tubes


def length(tubes):
    steps = np.linalg.norm(np.diff(tubes.points, axis=0), axis=1)
    return steps.sum() - steps[tubes.offsets[1:-1] - 1].sum()


def test_tubes_pass_through_the_control_points_and_loops_overlap_their_beginning():
    yarns = YarnSet.checked([circle(), straight()], closed=[True, False], radius=[0.5, 0.25])
    points, offsets = sampled_curves(yarns, 8)
    ring, line = points[: offsets[1]], points[offsets[1] :]
    assert np.allclose(ring[:-2:8], circle(), atol=1e-5)
    assert np.array_equal(ring[-2:], ring[:2])
    assert np.allclose(line[::8], straight(), atol=1e-5)
    tubes = drawn(yarn_scene("y", yarns))
    assert tubes.radius.tolist() == [0.5, 0.25]


def test_yarn_types_have_colors_and_a_legend():
    yarns = YarnSet.checked(
        [straight(0), straight(2), straight(4)],
        radius=[0.5, 0.25, 0.5],
        yarn_type=[0, 1, 0],
        type_names=("warp", "weft"),
    )
    scene = yarn_scene("y", yarns)
    tubes = drawn(scene)
    first = tubes.color[tubes.offsets[:-1]]
    assert (first[0] == first[2]).all()
    assert (first[0] != first[1]).any()
    assert [label for label, _ in scene.legend] == ["warp, radius 0.5 mm", "weft, radius 0.25 mm"]
    assert "3 yarns, 30 mm" in scene.title
    assert scene.notes == ()


@pytest.mark.parametrize("make", [yarn_scene, fiber_scene.fiber_scene])
def test_too_much_becomes_a_bounded_part_that_is_stated(monkeypatch, make):
    whole = curves()
    if make is yarn_scene:
        whole = YarnSet.checked([straight(0.6 * i) for i in range(20)], radius=0.2)
    assert make("x", whole).notes == ()
    total = length(drawn(make("x", whole)))
    monkeypatch.setattr(part, "TUBE_POINTS", 300)
    scene = make("x", whole)
    tubes = drawn(scene)
    assert 30 < len(tubes.points) <= 300
    (note,) = scene.notes
    assert note.startswith("part only")
    assert "--box" in note
    stated = float(note.split(" % ")[0].split()[-1])
    assert stated == pytest.approx(100 * length(tubes) / total, rel=0.2)


def test_a_box_shows_what_lies_in_it_and_says_so():
    box = np.array([[2.0, 0.25, -1.0], [4.0, 0.75, 1.0]])
    scene = fiber_scene.fiber_scene("f", curves(), box=box)
    tubes = drawn(scene)
    assert tubes.curve_count == 5  # y = 0.3 to 0.7
    assert (tubes.points > box[0]).all()
    assert (tubes.points < box[1]).all()
    assert np.ptp(tubes.points[:, 0]) > 1.6
    assert scene.notes[0].startswith("part: x 2..4, y 0.25..0.75")
    with pytest.raises(InputError, match="no fibers lies in it"):
        fiber_scene.fiber_scene("f", curves(), box=box + 100)


def test_a_curve_that_leaves_the_box_and_returns_is_two_tubes():
    x = np.array([0, 1, 2, 3, 4, 5, 6], float)
    points = np.stack([x, [0, 0, 0, 9, 0, 0, 0], 0 * x], axis=1)
    index, offsets = part.cut_to_box(points, np.array([0, 7]), np.array([[-1, -1, -1], [5.5, 1, 1.0]]))
    assert index.tolist() == [0, 1, 2, 4, 5]
    assert offsets.tolist() == [0, 3, 5]


def test_repeated_points_are_left_out_within_a_curve_only():
    points = np.array([[0, 0, 0], [0, 0, 0], [1, 0, 0], [1, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0.0]])
    index, offsets = part.without_repeats(points, np.array([0, 3, 5, 7]))
    assert index.tolist() == [0, 2, 5, 6]
    assert offsets.tolist() == [0, 2, 4]  # the second curve has no length


def test_plies_and_fly_aways_have_colors_of_their_own():
    scene = fiber_scene.fiber_scene("f", curves())
    assert [label for label, _ in scene.legend] == [
        "ply 1",
        "ply 2",
        "ply 3",
        "loop fly-aways",
        "hair fly-aways",
    ]
    colors = {tuple(color) for color in drawn(scene).color.tolist()}
    assert colors == {color for _, color in scene.legend}
    assert len(colors) == 5
    assert "19 fibers and 1 hair, 200 mm" in scene.title


def test_fibers_are_drawn_in_their_own_colors():
    """Linear 0.5 and 1 (and more) are 188 and 255 on a screen."""
    plain = curves()
    color = np.tile(np.float32([0.0, 0.5, 1.5]), (len(plain.points), 1))
    color[np.repeat(plain.ply, 50) == 1] = [1.0, 0.0, 0.0]
    scene = fiber_scene.fiber_scene("f", dataclasses.replace(plain, color=color))
    assert {tuple(c) for c in drawn(scene).color.tolist()} == {(0, 188, 255), (255, 0, 0)}
    assert scene.legend == (("ply 1", (0, 188, 255)), ("ply 2", (255, 0, 0)), ("ply 3", (0, 188, 255)))


def test_a_job_of_many_fibers_is_made_in_part_only(tmp_path):
    (tmp_path / "j.toml").write_text('[fibers]\npreset = "cotton2"\n')
    config: FibersConfig = load(tmp_path / "j.toml").table("fibers")
    yarns = YarnSet.checked([straight(0, 40.0), straight(3, 40.0)], radius=0.3)
    fibers = run_fibers(config, yarns)
    whole, total = fiber_scene.bounded_selection(fibers, FiberSelection())
    assert whole == FiberSelection()
    assert total == fibers.stretch_point_counts().sum()
    bounded, same = fiber_scene.bounded_selection(fibers, FiberSelection(), budget=total // 4)
    assert same == total
    made = fibers.stretch_point_counts()[select_stretches(fibers, bounded)].sum()
    assert 0 < made <= total // 4
    assert export_curves(fibers, bounded).curve_count > 0


def test_the_part_of_a_job_is_stated(tmp_path, monkeypatch):
    (tmp_path / "j.toml").write_text('[fibers]\npreset = "cotton2"\n')
    fibers = run_fibers(
        load(tmp_path / "j.toml").table("fibers"), YarnSet.checked([straight(0, 40.0)], radius=0.3)
    )
    monkeypatch.setattr(fiber_scene, "MADE_POINTS", 20_000)
    (note,) = fiber_scene.job_fiber_scene("j", fibers, FiberSelection()).notes
    assert note.startswith("part only")
    notes = fiber_scene.job_fiber_scene("j", fibers, FiberSelection(arc_length_mm=(0.0, 2.0))).notes
    assert notes == ("of the part that [export] chooses",)


@pytest.mark.parametrize("stride", [1, 2, 4, 8])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_slice_holds_the_densities_of_its_voxels(axis, stride):
    cloth = volume()
    region = grid_slice.region_of(cloth, None)
    whole = sum(dense(grid, region)[0] for grid in cloth.grids.values())
    for index in (int(region.low[axis]), int(region.high[axis]) - 3):
        expected = whole.take(index - region.low[axis], axis=axis)
        rows, columns = np.array(expected.shape) // stride
        expected = expected.reshape(rows, stride, columns, stride).mean(axis=(1, 3))
        found = grid_slice.density_plane(cloth, region, axis, index, stride)
        assert found == pytest.approx(expected, abs=1e-6)
    block = grid_slice.density_block(cloth, region, stride)
    assert block.sum() * stride**3 == pytest.approx(whole.sum(), rel=1e-5)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_directions_are_those_of_their_voxels(axis):
    cloth = volume()
    region = grid_slice.region_of(cloth, None)
    grid = cloth.grids["warp"]
    density, directions = dense(grid, region)
    index = int(grid.origins[4, axis]) + 3
    centers, found = grid_slice.plane_directions(grid, region, axis, index, 1)
    assert len(found) == np.count_nonzero(density.take(index - region.low[axis], axis=axis))
    voxel = np.floor(centers / cloth.voxel_size_mm).astype(int)
    assert (voxel[:, axis] == index).all()
    assert np.array_equal(directions[tuple((voxel - region.low).T)], found)
    sparse, _ = grid_slice.plane_directions(grid, region, axis, index, 3)
    assert 0 < len(sparse) < len(centers) / 6


def test_a_grid_shows_a_slice_with_directions_or_a_surface():
    cloth = volume()
    scene = grid_scene("g", cloth)
    assert [type(layer) for layer in scene.layers] == [Slice, Axes]
    assert scene.view == "front"
    assert "2 media" in scene.title
    assert scene.notes[0].startswith("slice z = ")
    scene = grid_scene("g", cloth, slices=(SlicePlane(0, 1.0), SlicePlane(1, 1.0)))
    assert [layer.axis for layer in scene.layers if isinstance(layer, Slice)] == [0, 1]
    (layer,) = grid_scene("g", cloth, surface=0.5).layers
    assert isinstance(layer, Surface)
    for wrong, what in (
        ({"slices": (SlicePlane(2, 99.0),)}, "--slice: z=99 misses the grid"),
        ({"surface": 9.0}, "--surface: no surface at a volume fraction of 9"),
        ({"box": np.array([[90, 90, 90], [91, 91, 91.0]])}, "nothing of the grid"),
    ):
        with pytest.raises(InputError, match=what):
            grid_scene("g", cloth, **wrong)


def test_a_few_large_densities_do_not_take_all_colors_and_are_stated():
    cloth = volume()
    grid = cloth.grids["warp"]
    spiky = grid.density.copy()
    spiky[spiky == spiky.max()] = 50.0
    layer = int(grid.origins[np.argmax(spiky.max(axis=1)), 2]) + int(np.argmax(spiky.max(axis=0))) % 8
    plane = SlicePlane(2, (layer + 0.5) * 0.5)
    scene = grid_scene("g", FiberVolume({"warp": replace(grid, density=spiky)}), slices=(plane,))
    (found,) = (layer for layer in scene.layers if isinstance(layer, Slice))
    assert found.top < 2.0
    assert "values reach 50" in scene.notes[0]


@pytest.mark.parametrize("scale", [1e-3, 0.1, 0.7, 3.0, 42.0, 1e4])
def test_the_scale_bar_is_round_and_as_long_as_it_says(scale):
    bar = bar_length(scale, 1280, 960)
    assert bar.pixels == pytest.approx(bar.mm * 960 / (2 * scale))
    assert 0.1 * 1280 < bar.pixels <= 0.28 * 1280 * (1 + 1e-9)
    assert f"{bar.mm:e}"[0] in "125"
    assert float(bar.label.removesuffix(" mm")) == pytest.approx(bar.mm)


@pytest.mark.parametrize("view", ["front", "top", "side", "iso"])
def test_the_camera_frames_the_box_below_the_heading(view):
    bounds = np.array([[1.0, 2.0, 3.0], [11.0, 5.0, 4.0]])
    panel = Panel(640, 480, heading=100.0, color_bar=True)
    camera = framed(bounds, view, panel, needed_scale(bounds, view, panel))
    right, up, _ = camera_axes(view)
    corners = np.stack(np.meshgrid(*bounds.T), axis=-1).reshape(-1, 3) - camera.focal_point
    pixels = 480 / (2 * camera.parallel_scale)
    x, y = corners @ right * pixels + 320, corners @ up * pixels + 240
    left_px, right_px, bottom_px, top_px = panel.free()
    assert x.min() > left_px - 1e-6
    assert x.max() < right_px + 1e-6
    assert y.min() > bottom_px - 1e-6
    assert y.max() < top_px + 1e-6
    fills = (np.ptp(x) / (right_px - left_px), np.ptp(y) / (top_px - bottom_px))
    assert max(fills) == pytest.approx(1.0)


def test_options_are_read_or_refused_in_one_line():
    assert parse_slice("z=0.5") == SlicePlane(2, 0.5)
    assert parse_slice("X=-1e1") == SlicePlane(0, -10.0)
    assert parse_box("0,0,0,1,2.5,3").tolist() == [[0, 0, 0], [1, 2.5, 3]]
    assert parse_size("640x480", 1) == (640, 480)
    assert parse_size(None, 3) == (2160, 720)
    for read, texts in (
        (parse_slice, ["0.5", "w=1", "z=nan", "z=", "z=1;2"]),
        (parse_box, ["0,0,0,1,1", "0,0,0,1,1,a", "1,0,0,0,1,1", "0,0,0,0,1,1", "0,0,0,inf,1,1"]),
        (lambda text: parse_size(text, 1), ["640", "0x0", "9999x9999", "-1x5", "640x480x3"]),
    ):
        for text in texts:
            with pytest.raises(InputError, match="--"):
                read(text)
