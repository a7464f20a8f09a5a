"""`correlation = "fibers"`: closed forms of its free flights, energy, and fibers traced one by one.

Error probability 1e-4 per z.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.peers.fiber_scenes import GRAY, bundle, rays_from_above, uniform_light
from tests.peers.fiber_tracer import FiberScene, FiberTracer
from weft.renderer.config import ConstantLight, OrthographicCamera, RenderConfig
from weft.renderer.kernel import KernelOptions
from weft.renderer.render import run
from weft.renderer.scene import IsotropicPhase
from weft.voxelize.config import VoxelizeConfig
from weft.voxelize.grid import FiberGrid
from weft.voxelize.voxelize import voxelize_segments

from .statistics import Z_LIMIT, picture_mean, z_score
from .test_transport import TABLE
from .volumes import RADIUS_MM, VOXEL_MM, random_grid, volume

pytestmark = pytest.mark.gl

ONE_FIBER = math.pi * RADIUS_MM**2 / VOXEL_MM**2
"""Volume fraction of a voxel that one fiber crosses along an axis of the grid."""


def lone_layers(fibers: float, layers: tuple[int, ...]) -> FiberGrid:
    """A brick whose voxels hold so many fibers along x, in some of its layers along z."""
    density = np.zeros((8, 8, 8), np.float32)
    density[:, :, list(layers)] = fibers * ONE_FIBER
    direction = np.zeros((1, 512, 3), np.float32)
    direction[..., 0] = density.reshape(1, 512) > 0
    origins = np.zeros((1, 3), np.int32)
    return FiberGrid(VOXEL_MM, RADIUS_MM, origins, density.reshape(1, 512), direction)


def coverage(grid: FiberGrid, view=(0.0, 0.0, 1.0)) -> tuple[float, float]:
    """Share of camera rays along the view that meet a fiber, and its standard error."""
    config = RenderConfig(
        resolution=(128, 128),
        samples_per_pixel=16,
        camera=OrthographicCamera(view_direction=view, frame_width_mm=1e-3),
        lights=[ConstantLight()],
        correlation="fibers",
    )
    share = float(run(config, volume(grid), {"a": IsotropicPhase((0, 0, 0))}).layers["A"].mean())
    return share, math.sqrt(share * (1 - share) / (128**2 * 16))


@pytest.mark.parametrize("fibers", [1.0, 2.0, 5.0])
def test_a_layer_hides_what_its_fibers_hide(fibers):
    """N fibers of width 2a at random places of a voxel h wide let (1 - 2a/h)^N pass."""
    share, error = coverage(lone_layers(fibers, (3,)))
    assert abs(share - (1 - (1 - 2 * RADIUS_MM / VOXEL_MM) ** fibers)) < Z_LIMIT * error


def test_half_a_fiber_in_each_of_two_layers_is_one():
    """A fiber on the boundary of two voxels hides no less than one within a voxel."""
    share, error = coverage(lone_layers(0.5, (3, 4)))
    assert abs(share - 2 * RADIUS_MM / VOXEL_MM) < Z_LIMIT * error


def test_layers_apart_are_independent():
    share, error = coverage(lone_layers(1.0, (1, 5)))
    assert abs(share - (1 - (1 - 2 * RADIUS_MM / VOXEL_MM) ** 2)) < Z_LIMIT * error


@pytest.mark.parametrize("peak", [0.02, 1.0])
def test_white_furnace(peak):
    """Whatever the law of free flights, a volume that absorbs nothing cannot be seen in uniform light."""
    config = RenderConfig(
        resolution=(32, 32),
        samples_per_pixel=64,
        max_bounces=10**6,
        camera=OrthographicCamera(view_direction=(0.3, 0.4, 1.0)),
        lights=[ConstantLight()],
        background="environment",
        sampling="both_plain",
        correlation="fibers",
    )
    grid = random_grid((3, 3, 3), seed=21, fill=0.6, peak=peak)
    result = run(config, volume(grid), {"a": TABLE["reference"]})
    assert abs(z_score(result, 1.0)) < Z_LIMIT
    assert picture_mean(result)[1] < 0.004


def test_cutting_the_work_up_changes_no_bit():
    config = RenderConfig(
        resolution=(16, 16), samples_per_pixel=4, lights=[ConstantLight()], correlation="fibers"
    )
    grid = random_grid((3, 3, 3), seed=22, peak=0.6)
    pictures = [
        run(config, volume(grid), {"a": TABLE["reference"]}, options=options).radiance
        for options in (
            KernelOptions(),
            KernelOptions(lane_count=64, rounds_per_dispatch=1, steps_per_round=3),
        )
    ]
    np.testing.assert_array_equal(*pictures)


def test_it_needs_exact_tracking():
    with pytest.raises(ValueError, match="exact"):
        RenderConfig(correlation="fibers", tracking="delta")
    with pytest.raises(ValueError, match="self_shadow_offset_fibers"):
        RenderConfig(correlation="fibers", self_shadow_offset_fibers=3.5)


def test_traced_fibers_hide_their_width():
    """One fiber: 2a of the square's width; the tracer's own check, as are the next two."""
    rng = np.random.default_rng(1)
    origin, direction = rays_from_above(200_000, 0.2, rng)
    met = FiberTracer(bundle(1, seed=3)).nearest(origin, direction, np.full(len(origin), -1))[0] >= 0
    share = 0.016 / 0.4
    assert abs(met.mean() - share) < Z_LIMIT * math.sqrt(share * (1 - share) / len(origin))


def test_traced_white_fibers_cannot_be_seen_in_uniform_light():
    rng = np.random.default_rng(2)
    origin, direction = rays_from_above(8_000, 0.15, rng)
    tracer = FiberTracer(bundle(200, seed=4))
    brought, met, bounces = tracer.radiance(origin, direction, TABLE["reference"], uniform_light, rng)
    values = np.where(met, brought[:, 0], 1.0)
    assert bounces.mean() > 3
    assert abs(values.mean() - 1) < Z_LIMIT * values.std() / math.sqrt(len(values))


def test_traced_fibers_at_random_places_are_exponential():
    """Poisson cylinders let exp(-2 a lambda L) pass, in the mean over 40 bundles."""
    rng = np.random.default_rng(5)
    passed = []
    for seed in range(40):
        count = rng.poisson(30)
        origin, direction = rays_from_above(2000, 0.12, rng)
        hit, _ = FiberTracer(bundle(count, seed=100 + seed)).nearest(origin, direction, np.full(2000, -1))
        passed.append((hit < 0).mean())
    expected = math.exp(-2 * 0.008 * 30 / 0.3**2 * 0.3)
    assert abs(np.mean(passed) - expected) < Z_LIMIT * np.std(passed) / math.sqrt(len(passed))


def test_a_slanted_fiber_hides_its_width():
    """It crosses some voxels through the middle, others at a corner, and is one fiber all the same."""
    turn = np.linalg.qr(np.array([[0.85, -0.45, 0.27], [0.47, 0.88, -0.02], [-0.23, 0.14, 0.96]]))[0]
    line = bundle(1, seed=1, length=1.6)
    scene = FiberScene((line.segments @ turn.T).astype(np.float32), line.fiber, line.radius_mm)
    origin, direction = rays_from_above(400_000, 0.2, np.random.default_rng(4))
    traced = (FiberTracer(scene).nearest(origin, direction, np.full(len(origin), -1))[0] >= 0).mean()
    config = RenderConfig(
        resolution=(64, 64),
        samples_per_pixel=128,
        camera=OrthographicCamera(position_mm=(0, 0, 2), target_mm=(0, 0, 0), frame_width_mm=0.4),
        lights=[ConstantLight()],
        correlation="fibers",
    )
    voxels = voxelize_segments(VoxelizeConfig(voxel_size_mm=0.03), scene.segments, fiber_radius_mm=0.008)
    share = run(config, voxels, {"fiber": IsotropicPhase((0, 0, 0))}).layers["A"].mean()
    assert abs(share / traced - 1) < 0.06


@pytest.mark.parametrize(
    ("count", "apart", "limits"),
    [
        (200, 0.016, {"none": (-0.03, 0.02), "fibers": (0.0, 0.05)}),
        (400, 0.0, {"none": (-0.21, -0.13), "fibers": (-0.03, 0.03)}),
        (30, 0.0, {"none": (-0.3, -0.15), "fibers": (-0.11, -0.05)}),
    ],
    ids=["dense and apart", "dense and overlapping", "thin"],
)
def test_the_volume_is_about_as_bright_as_its_fibers(count, apart, limits):
    """Voxels of 0.03 mm: what renderer/VOLUME_AGAINST_FIBERS.md says of both kinds of free flights."""
    scene = bundle(count, seed=6, apart=apart)
    rng = np.random.default_rng(7)
    origin, direction = rays_from_above(15_000, 0.1, rng)
    traced = FiberTracer(scene).radiance(origin, direction, GRAY, uniform_light, rng)[0].mean()
    voxels = voxelize_segments(
        VoxelizeConfig(voxel_size_mm=0.03), scene.segments, fiber_radius_mm=scene.radius_mm
    )
    for correlation, (low, high) in limits.items():
        config = RenderConfig(
            resolution=(32, 32),
            samples_per_pixel=24,
            camera=OrthographicCamera(position_mm=(0, 0, 2), target_mm=(0, 0, 0), frame_width_mm=0.2),
            lights=[ConstantLight()],
            correlation=correlation,
        )
        brighter = picture_mean(run(config, voxels, {"fiber": GRAY}))[0] / traced - 1
        assert low < brighter < high, correlation
