"""A picture does not depend on how much of the volume the device holds, and no path waits forever."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from weft.files.errors import InputError
from weft.renderer.batches import SMALLEST_SIDE, cell_footprints, occupied_cells, subdivide_screen
from weft.renderer.brick_pool import build_brick_pool
from weft.renderer.config import GaussianFilter, OrthographicCamera, PerspectiveCamera, RenderConfig
from weft.renderer.direction_encoding import decode_axis
from weft.renderer.kernel import KernelOptions
from weft.renderer.light_config import PointLight
from weft.renderer.pager import mean_bricks
from weft.renderer.render import run
from weft.renderer.residency import NOT_RESIDENT, Residency
from weft.renderer.scene import build_scene
from weft.renderer.surface_config import GroundSurface

from .test_kernel import CONFIG, GRIDS
from .test_transport import TABLE
from .volumes import random_grid, volume

LOBES = {"a": TABLE["reference"], "b": TABLE["rougher"]}
BRICK_MB = 2048 / 2**20
SCENES = {
    "exact": {},
    "delta": {"tracking": "delta"},
    "correlated": {"correlation": "fibers"},
    "cropped": {"crop": (5, 3, 14, 13)},
    "surfaces": {
        "surfaces": [GroundSurface()],
        "lights": [PointLight(position_mm=(1, 9, 2), intensity=(9, 9, 9))],
    },
    "filter and lens": {
        "filter": GaussianFilter(),
        "camera": PerspectiveCamera(aperture_radius_mm=0.1, focus_distance_mm=5),
    },
}


def picture(settings, **options):
    config = RenderConfig.model_validate(CONFIG.model_dump() | settings)
    return run(config, volume(*GRIDS), LOBES, options=KernelOptions(**options))


@pytest.mark.gl
@pytest.mark.parametrize("scene", SCENES)
def test_the_pool_changes_no_bit(scene):
    """Down to a pool of two bricks, as many as the media of one cell have."""
    usual = picture(SCENES[scene])
    for bricks, lanes in ((2, 1024), (9, 128)):
        other = picture(SCENES[scene] | {"brick_pool_mb": bricks * BRICK_MB}, lane_count=lanes)
        for name, layer in usual.layers.items():
            np.testing.assert_array_equal(layer, other.layers[name], err_msg=f"{name}, {bricks} bricks")
        assert other.statistics.tracking_steps == usual.statistics.tracking_steps
        assert other.statistics.scattering_events == usual.statistics.scattering_events
        assert other.statistics.brick_uploads >= other.statistics.bricks_used > bricks


@pytest.mark.gl
def test_paths_go_on_where_none_waits_for_a_brick():
    """The brick without a place lies where no path comes by: the last are only taken off their lanes."""
    near = random_grid((2, 2, 2), seed=4, fill=0.5, peak=0.05)
    far = np.array([[4000, 0, 0]], near.origins.dtype)
    grid = dataclasses.replace(
        near,
        origins=np.concatenate([near.origins, far]),
        density=np.concatenate([near.density, near.density[:1]]),
        direction=np.concatenate([near.direction, near.direction[:1]]),
    )
    camera = OrthographicCamera(target_mm=(0.8, 0.8, 0.8), frame_width_mm=1.6)
    config = CONFIG.model_copy(update={"camera": camera, "samples_per_pixel": 8})
    usual, other = (
        run(
            config.model_copy(update={"brick_pool_mb": pool}),
            volume(grid),
            LOBES,
            options=KernelOptions(lane_count=128),
        )
        for pool in (None, 8 * BRICK_MB)
    )
    np.testing.assert_array_equal(usual.radiance, other.radiance)
    assert other.statistics.bricks_used <= 8


@pytest.mark.gl
def test_a_pool_for_everything_is_no_pool():
    result = picture({"brick_pool_mb": 100.0})
    assert result.statistics.brick_uploads == 0


@pytest.mark.gl
def test_a_pool_too_small_for_one_cell_is_refused():
    with pytest.raises(InputError, match="a pool of 1 bricks cannot hold the 2 of one cell"):
        picture({"brick_pool_mb": 1.5 * BRICK_MB})


def test_the_stand_in_has_the_mean_density():
    pool = build_brick_pool(GRIDS)
    stand_in = mean_bricks(pool, np.array([2.0, 3.0]))
    words, records = stand_in.voxels, stand_in.records
    for medium, (grid, scale) in enumerate(zip(GRIDS, (2.0, 3.0), strict=True)):
        extinction = records[medium, :1].view(np.float32) * (words[medium] >> 20)
        np.testing.assert_allclose(extinction, grid.density.mean(dtype=np.float64) * scale, rtol=1e-6)
        assert records[medium, 1] == medium | 1 << 16
    axes = decode_axis(words & 0xFFFFF)
    np.testing.assert_allclose(
        np.einsum("mvi,mvj->ij", axes, axes) / axes[..., 0].size, np.eye(3) / 3, atol=0.05
    )


@pytest.mark.gl
def test_the_homogeneous_stand_in_is_another_picture():
    with pytest.raises(ValueError, match="has no effect without brick_pool_mb"):
        RenderConfig(outside_batch="homogeneous")
    pool = {"brick_pool_mb": 9 * BRICK_MB}
    exact, biased = picture(pool), picture(pool | {"outside_batch": "homogeneous"})
    assert np.isfinite(biased.radiance).all()
    assert biased.statistics.paths == exact.statistics.paths
    assert (biased.radiance != exact.radiance).mean() > 0.1


def random_residency(capacity, seed=7, cell_count=200):
    layers = np.random.default_rng(seed).integers(1, 4, cell_count)
    return Residency(np.cumsum(layers) - layers, layers, capacity)


@pytest.mark.parametrize("capacity", [3, 10, 150])
def test_slots_and_bricks_agree_and_the_first_cell_comes(capacity):
    residency = random_residency(capacity)
    rng = np.random.default_rng(11)
    for _ in range(200):
        wanted = rng.permutation(200)[: rng.integers(1, 60)]
        bricks, slots = residency.admit(wanted)
        assert len(np.unique(slots)) == len(slots)
        assert (residency.slot_of_brick[bricks] == slots).all()
        held = np.flatnonzero(residency.slot_of_brick != NOT_RESIDENT)
        assert (residency.brick_of_slot[residency.slot_of_brick[held]] == held).all()
        assert len(held) == np.count_nonzero(residency.brick_of_slot >= 0) <= capacity
        fitting = residency.fitting(wanted)
        assert fitting[0] == wanted[0]
        assert (residency.slot_of_brick[residency.bricks_of(fitting)] != NOT_RESIDENT).all()
        missing = residency.slot_of_brick == NOT_RESIDENT
        lacks = np.add.reduceat(missing, residency.first)
        np.testing.assert_array_equal(residency.resident(), lacks == 0)


def scene_of(camera, **settings):
    config = RenderConfig(resolution=(64, 48), camera=camera, **settings)
    return build_scene(
        config, volume(random_grid((6, 5, 4), seed=3, brick_fill=0.5)), {"a": TABLE["reference"]}
    )


CAMERAS = {
    "pinhole": PerspectiveCamera(view_direction=(0.5, 0.3, 1.0), fov_deg=40),
    "inside": PerspectiveCamera(position_mm=(1.2, 1.0, 0.8), target_mm=(0.2, 0.3, 0.1), fov_deg=90),
    "lens": PerspectiveCamera(fov_deg=40, aperture_radius_mm=0.2, focus_distance_mm=3.0),
    "orthographic": OrthographicCamera(view_direction=(0.5, 0.3, 1.0)),
}


@pytest.mark.parametrize("camera", CAMERAS)
def test_footprints_hold_every_camera_ray(camera):
    """Cells that rays through random places in random pixels pass: each knows the ray's pixel as its own."""
    scene = scene_of(CAMERAS[camera])
    cells = occupied_cells(scene.pool.cells)
    footprints = cell_footprints(cells.places, scene.uniforms(), 0.0)
    number = np.full(scene.pool.cells.shape, -1)
    number[tuple(cells.places.T)] = np.arange(len(cells.places))
    place = np.random.default_rng(5).random((3000, 2)) * (64, 48)
    origin, direction = camera_rays(scene.uniforms(), place)
    met = 0
    for t in np.linspace(0, np.linalg.norm(origin - scene.pool.size / 2, axis=1).max() + 40, 1000):
        cell = np.floor((origin + direction * t) / 8).astype(int)
        inside = ((cell >= 0) & (cell < number.shape)).all(axis=1)
        found = np.full(len(cell), -1)
        found[inside] = number[tuple(cell[inside].T)]
        rays, seen = np.flatnonzero(found >= 0), found[found >= 0]
        pixel = np.floor(place[rays]).astype(int)
        assert (footprints.low[seen] <= pixel).all()
        assert (pixel <= footprints.high[seen]).all()
        met += len(rays)
    assert met > 10_000


def camera_rays(camera, place):
    """Origins and unit directions through these places [pixels], from random places on the lens [voxels]."""
    rng = np.random.default_rng(6)
    axes = np.stack([camera["camera_right"], camera["camera_up"]])
    across = (place / (64, 48) * 2 - 1) * (1, -1) @ axes
    origin = np.broadcast_to(np.array(camera["camera_position"]), across.shape)
    direction = np.broadcast_to(np.array(camera["camera_forward"]), across.shape)
    if camera["camera_perspective"]:
        direction = direction + across
    else:
        origin = origin + across
    radius, focus = camera["lens"][:2]
    turn = 2 * np.pi * rng.random(len(place))
    disk = radius * np.sqrt(rng.random((len(place), 1))) * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    shift = disk @ (axes / np.linalg.norm(axes, axis=1, keepdims=True))
    direction = direction * (focus if radius else 1.0) - shift
    return origin + shift, direction / np.linalg.norm(direction, axis=1, keepdims=True)


@pytest.mark.parametrize("capacity", [1, 10, 40, 1000])
def test_batches_tile_the_screen_and_fit(capacity):
    scene = scene_of(CAMERAS["pinhole"])
    cells = occupied_cells(scene.pool.cells)
    footprints = cell_footprints(cells.places, scene.uniforms(), 0.0)
    covered = np.zeros((48, 64), int)
    batches = subdivide_screen(range(3, 60), range(5, 41), footprints, cells.layers, capacity)
    for batch in batches:
        covered[batch.rows.start : batch.rows.stop, batch.columns.start : batch.columns.stop] += 1
        small = max(len(batch.rows), len(batch.columns)) <= SMALLEST_SIDE
        assert small or cells.layers[batch.cells].sum() <= capacity
        assert (np.diff(footprints.depth[batch.cells]) >= 0).all()
    assert (covered[5:41, 3:60] == 1).all()
    assert covered.sum() == 36 * 57
    assert len(batches) > 1 or capacity >= 40
