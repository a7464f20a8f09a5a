"""Levels of detail: which are chosen, that they cover each place once, and how far the picture moves."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from weft.files.errors import InputError
from weft.renderer.batches import cell_footprints, occupied_cells
from weft.renderer.camera import place_camera
from weft.renderer.config import BoxFilter, ConstantLight, OrthographicCamera, PerspectiveCamera, RenderConfig
from weft.renderer.detail import choose_bricks, pixel_footprint
from weft.renderer.level_files import open_levels
from weft.renderer.render import attributes, run
from weft.renderer.scene import IsotropicPhase, build_scene
from weft.renderer.volume_levels import VolumeLevels
from weft.voxelize.grid import FiberGrid, FiberVolume
from weft.voxelize.level_of_detail import coarsen

from .statistics import Z_LIMIT
from .test_kernel import CONFIG, GRIDS
from .test_transport import TABLE
from .volumes import RADIUS_MM, VOXEL_MM, random_grid, uniform_grid, volume

BLACK = {"a": IsotropicPhase((0.0, 0.0, 0.0))}
BOUNDS = np.array([[0.0, 0, 0], [9.6, 1.6, 1.6]])
ALONG = PerspectiveCamera(position_mm=(-0.5, 0.7, 0.9), target_mm=(5.0, 0.8, 0.8), fov_deg=40)
"""Looks along a bar of 24 x 4 x 4 bricks, with the near end 0.5 mm and the far end 10 mm away."""
LENS = ALONG.model_copy(update={"aperture_radius_mm": 0.05, "focus_distance_mm": 3.0})


def leveled(finest: FiberVolume, count: int = 3, lobes: int = 2) -> VolumeLevels:
    coarser = [coarsen(finest, factor=2**n, lobes=lobes) for n in range(1, count)]
    return VolumeLevels((finest, *coarser), (0.0, *[0.01 * n for n in range(1, count)]))


def looking(camera, pixels, **settings):
    return RenderConfig(
        resolution=(32, 32),
        samples_per_pixel=16,
        camera=camera,
        lights=[ConstantLight()],
        background="environment",
        detail_pixels=pixels,
        **settings,
    )


def bar(seed=5):
    return random_grid((24, 4, 4), seed=seed, fill=0.5, peak=0.05, brick_fill=0.8)


def all_places(level, shape=(24, 4, 4)):
    return np.array(list(np.ndindex(tuple(-(-n >> level) for n in shape))))


@pytest.mark.parametrize("pixels", [0.5, 1.0, 3.0])
def test_the_level_follows_from_depth_and_footprint(pixels):
    """Of bricks straight ahead: edge 2^k h <= pixels 2 tan(fov / 2) depth / width, and 2^(k+1) h is not."""
    camera = PerspectiveCamera(position_mm=(0, 0, -1), target_mm=(0, 0, 0), fov_deg=30)
    frame = place_camera(camera, np.array([[-1.0, -1, 0], [1, 1, 40]]), (50, 50))
    footprint = pixel_footprint(frame, (50, 50))
    places = [np.array([[0, 0, z] for z in range(100 >> level)]) for level in range(4)]
    chosen = choose_bricks(places, VOXEL_MM, footprint, pixels)
    for level, (bricks, kept) in enumerate(zip(places, chosen, strict=True)):
        for z in bricks[kept, 2]:
            edge = VOXEL_MM * 2**level

            def depth(low, size):
                return 1 + low * size * 8

            allowed = pixels * 2 * np.tan(np.radians(15)) / 50
            assert level == 0 or edge <= allowed * depth(z, edge) * (1 + 1e-9)
            if level < 3:
                assert 2 * edge > allowed * depth(z >> 1, 2 * edge) * (1 - 1e-9)
    assert sum(kept.any() for kept in chosen) >= 3


def test_an_orthographic_camera_has_one_level():
    frame = place_camera(OrthographicCamera(frame_width_mm=10), BOUNDS, (50, 50))
    places = [all_places(level) for level in range(4)]
    for pixels, expected in ((0.2, 0), (0.5, 1), (0.99, 1), (1.0, 2), (2.0, 3), (99.0, 3)):
        chosen = choose_bricks(places, VOXEL_MM, pixel_footprint(frame, (50, 50)), pixels)
        assert [kept.all() for kept in chosen] == [level == expected for level in range(4)]


@pytest.mark.parametrize("camera", [ALONG, LENS, PerspectiveCamera(position_mm=(4, 0.8, 0.8), fov_deg=90)])
def test_each_place_is_covered_once_and_finely_enough(camera):
    """Also with bricks behind the camera, and around it."""
    frame = place_camera(camera, BOUNDS, (40, 40))
    footprint, places = pixel_footprint(frame, (40, 40)), [all_places(level) for level in range(4)]
    covered = np.zeros((24, 4, 4), int)
    for level, kept in enumerate(choose_bricks(places, VOXEL_MM, footprint, 1.5)):
        for place in places[level][kept]:
            low = place << level
            covered[tuple(slice(n, n + (1 << level)) for n in low)] += 1
            if level:
                _refuse_coarse(frame, low * 8 * VOXEL_MM, 8 * VOXEL_MM * 2**level, VOXEL_MM * 2**level)
    assert (covered == 1).all()


def _refuse_coarse(frame, low, size, edge):
    """At random points of a brick that the picture shows, a voxel's edge is at most 1.5 pixels."""
    points = low + np.random.default_rng(1).random((50, 3)) * size - frame.position
    depth = points @ frame.forward
    pixel = depth * 2 * np.linalg.norm(frame.right) / 40
    across = [np.abs(points @ side) / np.linalg.norm(side) ** 2 for side in (frame.right, frame.up)]
    seen = (depth > 0) & (np.maximum(*across) < depth)
    assert (edge <= 1.5 * pixel[seen] * (1 + 1e-9)).all()


@pytest.mark.gl
@pytest.mark.parametrize("tracking", ["exact", "delta"])
def test_a_threshold_below_all_voxels_changes_no_bit(tracking):
    config = CONFIG.model_copy(update={"tracking": tracking})
    lobes = dict.fromkeys(("a", "b", "a_crossing", "b_crossing"), TABLE["reference"])
    usual = run(config, volume(*GRIDS), lobes)
    levels = leveled(volume(*GRIDS))
    for other in (
        run(config.model_copy(update={"detail_pixels": 1e-3}), levels, lobes),
        run(config, levels, lobes),
    ):
        assert sum(share.brick_count for share in other.statistics.detail[1:]) == 0
        for name, layer in usual.layers.items():
            np.testing.assert_array_equal(layer, other.layers[name], err_msg=name)


@pytest.mark.gl
@pytest.mark.parametrize("camera", [ALONG, OrthographicCamera(view_direction=(0.3, 0.5, 1.0))])
def test_equal_density_is_as_deep_at_every_level(camera):
    """No gap and nothing twice where levels meet: the same rays end at the same places.

    The block begins at no multiple of the coarse bricks, so these reach beyond it.
    """
    start = np.array([-3, 5, 1])
    grid = uniform_grid((24, 4, 4), 0.004, (1, 2, 3))
    grid = dataclasses.replace(grid, origins=(grid.origins + 8 * start).astype(np.int32))
    levels = leveled(volume(grid), lobes=1)
    if camera.kind == "perspective":
        move = start * 8 * VOXEL_MM
        camera = camera.model_copy(
            update={
                "position_mm": tuple(camera.position_mm + move),
                "target_mm": tuple(camera.target_mm + move),
            }
        )
    full = run(looking(camera, None), levels.levels[0], BLACK)
    for pixels in (1.0, 3.0):
        mixed = run(looking(camera, pixels), levels, BLACK)
        assert mixed.statistics.detail[-1].level >= 1
        np.testing.assert_allclose(mixed.radiance, full.radiance, atol=1e-7)
        np.testing.assert_allclose(mixed.layers["Z"], full.layers["Z"], rtol=2e-5)
        assert mixed.statistics.device_bytes < 0.9 * full.statistics.device_bytes
    if camera.kind == "orthographic":
        assert mixed.statistics.tracking_steps < 0.7 * full.statistics.tracking_steps


def test_a_coarse_brick_is_seen_wherever_its_cells_are():
    """What batches load beforehand: pixels that see any of its cells see the brick."""
    frame = place_camera(ALONG, BOUNDS, (40, 40))
    camera = {
        "image_size": (40, 40),
        "camera_position": tuple(frame.position / VOXEL_MM),
        "camera_forward": tuple(frame.forward),
        "camera_right": tuple(frame.right),
        "camera_up": tuple(frame.up),
        "camera_perspective": 1,
        "lens": (0.0, 1.0, 0.0, 0.0),
    }
    pool = build_scene(looking(ALONG, 3.0), independent_levels(), BLACK).pool
    bricks = occupied_cells(pool.cells, leveled=True)
    assert (np.diff(bricks.first) == bricks.layers[:-1]).all()
    assert set(bricks.sides) == {1, 2, 4, 8}
    assert (bricks.places % bricks.sides[:, None] == 0).all()
    seen = cell_footprints(bricks.places, camera, 0.0, bricks.sides)
    for place, side, low, high in zip(bricks.places, bricks.sides, seen.low, seen.high, strict=True):
        cells = place + np.array(list(np.ndindex((side,) * 3)))
        single = cell_footprints(cells, camera, 0.0)
        visible = (single.high >= single.low).all(axis=1)
        assert (single.low[visible] >= low).all()
        assert (single.high[visible] <= high).all()


@pytest.mark.gl
def test_a_pool_of_few_bricks_changes_no_bit():
    """Down to as many as one place has: bricks of several levels are loaded when paths want them."""
    levels, lobes = leveled(volume(bar(5), bar(6)), count=4), {"a": TABLE["reference"]}
    config = looking(ALONG, 3.0).model_copy(update={"samples_per_pixel": 4})
    usual = run(config, levels, lobes)
    bricks = usual.statistics.device_bytes // 2048
    for count in (4, bricks // 8):
        pool = {"brick_pool_mb": count * 2048 / 2**20}
        other = run(config.model_copy(update=pool), levels, lobes)
        for name, layer in usual.layers.items():
            np.testing.assert_array_equal(layer, other.layers[name], err_msg=name)
        assert other.statistics.brick_uploads > other.statistics.bricks_used > count


def two_valued(grid: FiberGrid) -> FiberGrid:
    """Densities 0 and 0.02, which 12 bits hold exactly in bricks of any level."""
    density = np.where(grid.density > 0, np.float32(0.02), np.float32(0))
    return dataclasses.replace(grid, density=density)


def independent_levels(count=4, shape=(24, 4, 4)) -> VolumeLevels:
    """Levels that have nothing in common, so that a voxel taken from a wrong one shows."""
    grids = []
    for level in range(count):
        places = tuple(n >> level for n in shape)
        grid = two_valued(random_grid(tuple(max(n, 1) for n in places), seed=70 + level, fill=0.2))
        grids.append(dataclasses.replace(grid, voxel_size_mm=VOXEL_MM * 2**level))
    return VolumeLevels(tuple(volume(grid) for grid in grids))


def written_finely(levels: VolumeLevels, config: RenderConfig) -> FiberVolume:
    """The chosen bricks of all levels as voxels of the finest; their dye as well, where they have any."""
    frame = place_camera(config.camera, levels.bounds_mm, config.resolution)
    grids = [level.grids["a"] for level in levels.levels]
    chosen = choose_bricks(
        [grid.origins // 8 for grid in grids],
        VOXEL_MM,
        pixel_footprint(frame, config.resolution),
        config.detail_pixels,
    )
    size = np.array([24, 8, 8]) * 8  # whole bricks of the coarsest
    density, axis = np.zeros(size, np.float32), np.zeros((*size, 3), np.float32)
    dye = None if grids[0].albedo is None else np.zeros((*size, 3), np.float32)
    for level, (grid, kept) in enumerate(zip(grids, chosen, strict=True)):
        for row in np.flatnonzero(kept):
            box = tuple(slice(n << level, (n + 8) << level) for n in grid.origins[row])
            fine = np.ones((1 << level,) * 3, np.float32)
            density[box] = np.kron(grid.density[row].reshape(8, 8, 8), fine)
            axis[box] = np.kron(grid.direction[row].reshape(8, 8, 8, 3), fine[..., None])
            if dye is not None:
                dye[box] = np.kron(grid.albedo[row].reshape(8, 8, 8, 3), fine[..., None])
    origins = random_grid((24, 8, 8), seed=0).origins
    boxes = [tuple(slice(n, n + 8) for n in origin) for origin in origins]
    return volume(
        FiberGrid(
            VOXEL_MM,
            RADIUS_MM,
            origins,
            np.stack([density[box].reshape(512) for box in boxes]),
            np.stack([axis[box].reshape(512, 3) for box in boxes]),
            albedo=None if dye is None else np.stack([dye[box].reshape(512, 3) for box in boxes]),
        )
    )


@pytest.mark.gl
@pytest.mark.parametrize("settings", [{}, {"tracking": "delta"}], ids=["exact", "delta"])
def test_coarse_voxels_are_the_same_voxels_written_finely(settings):
    """Black fibers: every path ends where it would among the finest voxels, but for rounding.

    Delta tracking takes other random numbers, so there only the mean agrees: |z| < 3.9, error 1e-4.
    """
    levels, config = independent_levels(), looking(ALONG, 3.0, filter=BoxFilter(), **settings)
    mixed = run(config, levels, BLACK)
    fine = run(config.model_copy(update={"detail_pixels": None}), written_finely(levels, config), BLACK)
    assert sum(share.brick_count > 0 for share in mixed.statistics.detail) >= 3
    assert mixed.statistics.majorant_violations == 0
    assert 0.05 < fine.radiance.mean() < 0.95
    if not settings:
        assert (np.abs(mixed.radiance - fine.radiance) < 1e-6).mean() > 0.995
        met = np.isfinite(fine.layers["Z"])
        close = np.isclose(mixed.layers["Z"][met], fine.layers["Z"][met], rtol=1e-4)
        assert close.mean() > 0.99
        for name in ("T.X", "T.Y", "T.Z"):
            assert np.isclose(np.abs(mixed.layers[name]), np.abs(fine.layers[name]), atol=2e-3).mean() > 0.98
    variance = sum(result.layers["variance.G"].sum() for result in (mixed, fine))
    difference = (mixed.layers["G"] - fine.layers["G"]).sum()
    assert abs(difference) < Z_LIMIT * np.sqrt(variance)


def with_dye(grid: FiberGrid, seed: int) -> FiberGrid:
    """In random colors, voxel by voxel."""
    albedo = np.random.default_rng(seed).random((*grid.density.shape, 3), np.float32)
    return dataclasses.replace(grid, albedo=albedo * (grid.density > 0)[..., None])


@pytest.mark.gl
@pytest.mark.parametrize("settings", [{}, {"correlation": "fibers"}, {"tracking": "delta"}], ids=str)
def test_light_is_conserved_where_levels_meet(settings):
    """A white furnace through a volume of several levels, two lobes and media that overlap."""
    levels = leveled(volume(bar(5), bar(6)), count=4)
    white = dataclasses.replace(TABLE["reference"], color_r=(1.0,) * 3, color_tt=(1.0,) * 3)
    white = dataclasses.replace(white, color_trt=(1.0,) * 3)
    config = looking(ALONG, 3.0, max_bounces=100_000, roulette_start=100_000, **settings)
    result = run(config, levels, {"a": white})
    assert sum(share.brick_count > 0 for share in result.statistics.detail) >= 3
    assert result.statistics.scattering_events > 5000
    error = np.sqrt(result.layers["variance.G"].sum()) / result.layers["G"].size
    assert abs(result.layers["G"].mean() - 1) < max(Z_LIMIT * error, 1e-4)
    assert result.statistics.broken_samples == 0


def test_fiber_is_conserved_by_the_choice():
    levels = leveled(volume(bar()), count=4)
    full = build_scene(looking(ALONG, None), levels.levels[0], BLACK).pool
    held = (full.voxels >> 20).sum(axis=1) @ full.density_step.astype(float)
    for pixels in (0.5, 1.0, 2.0, 4.0):
        pool = build_scene(looking(ALONG, pixels), levels, BLACK).pool
        assert pool.coarsest_level >= 1
        level = brick_levels(pool)
        mixed = ((pool.voxels >> 20).sum(axis=1) * pool.density_step * 8.0**level).sum()
        assert mixed == pytest.approx(held, rel=1e-5)
        assert sum(share.fiber_share for share in pool.detail) == pytest.approx(1)


def brick_levels(pool):
    """Of each brick, from the words of the cells."""
    words = pool.cells[pool.cells < 1 << 31]
    level = np.zeros(len(pool.voxels), int)
    for layer in range(pool.layer_count):
        within = (words >> 28) >= layer
        level[(words[within] & 0x1FFFFFF) + layer] = words[within] >> 25 & 7
    return level


@pytest.mark.gl
def test_smaller_thresholds_make_smaller_errors():
    """The opacity of a thread against full detail, with the same random numbers."""
    levels = leveled(volume(thread()), count=4)
    lobes = {"a": TABLE["reference"]}
    camera = OrthographicCamera(view_direction=(0, 0.2, 1.0), frame_width_mm=6.4)
    config = looking(camera, None).model_copy(update={"samples_per_pixel": 64})
    full = run(config, levels.levels[0], lobes)
    errors, sizes = [], []
    for pixels in (4.0, 1.0, 0.5):
        result = run(config.model_copy(update={"detail_pixels": pixels}), levels, lobes)
        errors.append(float(np.sqrt(((result.layers["A"] - full.layers["A"]) ** 2).mean())))
        sizes.append(result.statistics.device_bytes)
        last = result.statistics.detail[-1]
        told = f"in voxels of {last.voxel_size_mm:g} mm (extinction off by 0.0{last.level})"
        assert attributes(result)["weft.detail"].endswith(told)
    assert "weft.detail" not in attributes(full)
    assert errors[0] > 1.5 * errors[1] > 0
    assert errors[1] > 1.2 * errors[2] > 0
    assert max(sizes) < full.statistics.device_bytes


def thread() -> FiberGrid:
    """Fibers along x in a helix of voxels, at the scale of which coarse voxels blur."""
    grid = random_grid((12, 4, 4), seed=8, fill=1.0, peak=0.2)
    local = np.stack(np.meshgrid(*[np.arange(8)] * 3, indexing="ij"), -1).reshape(-1, 3)
    place = (grid.origins[:, None] + local + 0.5).astype(float)
    turn = place[..., 0] * 2 * np.pi / 48
    y, z = 16 + 8 * np.cos(turn), 16 + 8 * np.sin(turn)
    inside = (place[..., 1] - y) ** 2 + (place[..., 2] - z) ** 2 < 4.0**2
    density = np.where(inside, np.float32(0.2), np.float32(0))
    axis = np.broadcast_to(np.float32([1, 0, 0]), grid.direction.shape) * inside[..., None]
    return dataclasses.replace(grid, density=density, direction=axis.astype(np.float32))


def test_a_volume_without_levels_is_refused():
    with pytest.raises(InputError, match="has no coarser levels"):
        build_scene(looking(ALONG, 1.0), volume(bar()), BLACK)
    with pytest.raises(ValueError, match="detail_pixels and outside_batch do not go together"):
        looking(ALONG, 1.0, brick_pool_mb=64, outside_batch="homogeneous")
    with pytest.raises(InputError, match=r"level 1 has voxels of 0\.2 mm; 0\.1 mm are right"):
        VolumeLevels((volume(bar()), coarsen(volume(bar()), factor=4)))


def test_levels_on_the_disk_are_those_in_memory(tmp_path):
    pytest.importorskip("weft.voxelize._openvdb", reason="OpenVDB is not installed")
    from weft.voxelize.vdb import write_volume

    levels, path = leveled(volume(with_dye(bar(), 2))), tmp_path / "volume.vdb"
    write_volume(path, levels.levels[0])
    with pytest.raises(InputError, match=r"there is no volume_level1\.vdb beside it.*voxelize\.levels"):
        open_levels(path)
    for number, level in enumerate(levels.levels[1:], start=1):
        about = {
            "level": number,
            "finest_content_sha256": levels.levels[0].content_sha256,
            "extinction_error_rms": 0.01 * number,
        }
        write_volume(tmp_path / f"volume_level{number}.vdb", dataclasses.replace(level, about=about))
    stored, config = open_levels(path), looking(ALONG, 1.0)
    assert stored.content_sha256 == levels.content_sha256
    one, two = (build_scene(config, source, BLACK).pool for source in (levels, stored))
    for field in dataclasses.fields(one):
        np.testing.assert_array_equal(getattr(one, field.name), getattr(two, field.name), field.name)
    lazy = build_scene(config.model_copy(update={"brick_pool_mb": 1.0}), stored, BLACK).pool
    assert not isinstance(lazy.voxels, np.ndarray)
    for field in dataclasses.fields(one):
        if field.name != "voxels":
            np.testing.assert_array_equal(getattr(one, field.name), getattr(lazy, field.name), field.name)
    some = np.random.default_rng(1).integers(0, len(one.voxels), 50)
    np.testing.assert_array_equal(one.voxels[some], lazy.voxels[some])
    np.testing.assert_array_equal(one.voxels[3:9], lazy.voxels[3:9])
    write_volume(path, volume(bar(seed=9)))
    with pytest.raises(InputError, match=r"is a level of another volume than volume\.vdb"):
        open_levels(path)
