"""Homogeneous media, further grids, extinction by color. Each z stays below 3.9: error probability 1e-4."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydantic import ValidationError

from weft.files.errors import InputError
from weft.renderer.config import (
    ConstantLight,
    DirectionalLight,
    OrthographicCamera,
    PerspectiveCamera,
    QuadLight,
    RenderConfig,
)
from weft.renderer.gpu.context import shared_context
from weft.renderer.kernel import Kernel, KernelOptions
from weft.renderer.media_config import (
    BallBound,
    BoxBound,
    GridMedium,
    HenyeyGreensteinScattering,
    HomogeneousMedium,
    IsotropicScattering,
    MeshBound,
)
from weft.renderer.passes import Pass
from weft.renderer.render import run
from weft.renderer.scene import build_scene
from weft.renderer.simple_phases import IsotropicPhase
from weft.renderer.surface_config import BallSurface, DiffuseMaterial, Placement

from .meshes import write_ball
from .statistics import Z_LIMIT, picture_mean, welch_z, z_score
from .test_transport import TABLE
from .volumes import VOXEL_MM, random_grid, uniform_grid, volume

pytestmark = pytest.mark.gl

COLORS = (0.5, 1.0, 3.0)
NOTHING = uniform_grid((2, 2, 2), 0.0, (0.0, 1.0, 0.0))
BLACK = IsotropicScattering(albedo=0.0)
BLACK_FIBERS = {"a": IsotropicPhase((0.0, 0.0, 0.0))}
SLAB = BoxBound(lower_mm=(-0.35, -50.0, -50.0), upper_mm=(0.65, 50.0, 50.0))
"""One millimeter thick, its faces inside of voxels."""
PERSPECTIVE = PerspectiveCamera(fov_deg=14, view_direction=(0.3, 0.4, 1.0))


def picture(media, grids=(NOTHING,), phases=None, *, options=None, **settings):
    defaults = {
        "resolution": (32, 32),
        "samples_per_pixel": 64,
        "max_bounces": 10**6,
        "camera": OrthographicCamera(view_direction=(1.0, 0.0, 0.0), frame_width_mm=1e-3),
        "lights": [ConstantLight()],
        "background": "environment",
    }
    config = RenderConfig(**(defaults | settings | {"media": media}))
    return run(config, volume(*grids), phases or BLACK_FIBERS, options=options)


def fog(bound=SLAB, extinction=COLORS, scattering=BLACK):
    return HomogeneousMedium(bound=bound, extinction_per_mm=extinction, scattering=scattering)


@pytest.mark.parametrize("parts", [1, 3])
def test_each_color_passes_a_slab_by_its_own_extinction(parts):
    """exp(-sigma L) by channel, also of the parts of a medium that overlap."""
    media = [fog(extinction=tuple(s / parts for s in COLORS))] * parts
    result = picture(media)
    for channel, sigma in enumerate(COLORS):
        assert abs(z_score(result, math.exp(-sigma), channel=channel)) < Z_LIMIT


def test_a_ball_dims_by_its_chord():
    camera = OrthographicCamera(view_direction=(1.0, 0.0, 0.0), frame_width_mm=1e-3, target_mm=(0, 0.3, 0.4))
    result = picture([fog(BallBound(radius_mm=0.7))], camera=camera)
    chord = 2 * math.sqrt(0.7**2 - 0.3**2 - 0.4**2)
    for channel, sigma in enumerate(COLORS):
        assert abs(z_score(result, math.exp(-sigma * chord), channel=channel)) < Z_LIMIT


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_each_color_scatters_once_in_a_slab_as_its_closed_form(side):
    """Light along the view: albedo/(4 pi) (1 - exp(-2 sigma L))/2 back, sigma L exp(-sigma L) onward."""
    albedo = (0.9, 0.5, 0.7)
    result = picture(
        [fog(scattering=IsotropicScattering(albedo=albedo))],
        max_bounces=1,
        lights=[DirectionalLight(direction=(side, 0.0, 0.0))],
        samples_per_pixel=256,
    )
    for channel, sigma in enumerate(COLORS):
        along = (1 - math.exp(-2 * sigma)) / 2 if side > 0 else sigma * math.exp(-sigma)
        expected = albedo[channel] * along / (4 * math.pi)
        assert abs(z_score(result, expected, channel=channel)) < Z_LIMIT


@pytest.mark.parametrize("fibers", [False, True])
def test_white_furnace_in_colored_fog(fibers):
    """Albedo 1 everywhere, in whatever colors light is dimmed: each channel is 1, also from within."""
    grids = (random_grid((3, 3, 3), seed=21, fill=0.6, peak=0.4),) if fibers else (NOTHING,)
    phases = {"a": TABLE["reference"]} if fibers else None
    media = [
        fog(BoxBound(lower_mm=(0.1, 0.1, -0.3), upper_mm=(0.9, 1.6, 0.9)), (0.3, 2.0, 6.0)),
        fog(BallBound(position_mm=(0.5, 0.5, 0.5), radius_mm=0.5), 2.5),
    ]
    kinds = [HenyeyGreensteinScattering(g=0.7), IsotropicScattering()]
    media = [m.model_copy(update={"scattering": kind}) for m, kind in zip(media, kinds, strict=True)]
    within = PerspectiveCamera(position_mm=(0.5, 0.6, 0.5), target_mm=(1.0, 0.7, 0.4), fov_deg=60)
    camera = within if fibers else PERSPECTIVE
    result = picture(media, grids, phases, camera=camera, sampling="both_plain")
    assert result.statistics.broken_samples == 0
    assert result.layers["A"].mean() > 0.3
    for channel in range(3):
        assert abs(z_score(result, 1.0, channel=channel)) < Z_LIMIT


@pytest.mark.proof
def test_a_colored_fog_glows_as_its_closed_form():
    glow = IsotropicScattering(albedo=0.0, emission=(3.0, 2.0, 1.0))
    result = picture([fog(scattering=glow)], lights=[ConstantLight(radiance=(0.0, 0.0, 0.0))])
    for channel, (sigma, emission) in enumerate(zip(COLORS, (3.0, 2.0, 1.0), strict=True)):
        assert abs(z_score(result, emission * -math.expm1(-sigma), channel=channel)) < Z_LIMIT


@pytest.mark.proof
def test_a_gray_box_is_the_grid_that_fills_it():
    """The same block as a homogeneous medium and as voxels of isotropic extinction."""
    side = 16 * VOXEL_MM
    scattering = HenyeyGreensteinScattering(g=0.5, albedo=(0.9, 0.6, 0.3))
    box = BoxBound(lower_mm=(0, 0, 0), upper_mm=(side, side, side))
    scene = {"camera": PERSPECTIVE, "lights": [DirectionalLight(direction=(1, 2, 3)), ConstantLight()]}
    one = picture([fog(box, 2.0, scattering)], **scene)
    block = uniform_grid((2, 2, 2), 0.02, (0, 1, 0))
    other = picture(
        [],
        (block,),
        {"a": scattering.to_phase()},
        extinction="isotropic",
        isotropic_extinction_per_mm=100.0,
        seed=1,
        **scene,
    )
    for channel in range(3):
        assert abs(welch_z(one, other, channel=channel)) < Z_LIMIT


def test_a_mesh_bounds_a_medium_as_the_ball_that_it_is(tmp_path):
    """To half a voxel: a ball of 1280 triangles has 0.7 % less volume, a mean chord shorter by as much."""
    ball = write_ball(tmp_path, subdivisions=4)
    scene = {"camera": PERSPECTIVE, "samples_per_pixel": 16}
    mesh = MeshBound(file=ball, placement=Placement(scale=0.5, position_mm=(0.4, 0.4, 0.4)))
    exact = BallBound(position_mm=(0.4, 0.4, 0.4), radius_mm=0.5)
    means = [picture([fog(bound, (1.0, 2.0, 4.0))], **scene) for bound in (mesh, exact)]
    for channel in range(3):
        (one, _), (other, _) = (picture_mean(result, channel=channel) for result in means)
        assert one < 0.99
        assert abs(one - other) < 0.02 * (1 - other)


def test_a_surface_and_a_lamp_inside_of_colored_fog():
    """What the camera sees through 1 mm of it: a black ball, and a lamp whose light is dimmed by color."""
    ball = BallSurface(position_mm=(0.0, 0.4, 0.4), radius_mm=0.5, material=DiffuseMaterial(color=(0, 0, 0)))
    dark = picture([fog()], surfaces=[ball])
    assert dark.radiance.max() == 0
    lamp = QuadLight(
        position_mm=(-1.0, 0.4, 0.4), target_mm=(9.0, 0.4, 0.4), width_mm=1, height_mm=1, radiance=(3, 2, 1)
    )
    lit = picture([fog()], lights=[lamp, ConstantLight(radiance=(0.0, 0.0, 0.0))])
    for channel, sigma in enumerate(COLORS):
        assert abs(z_score(lit, lamp.radiance[channel] * math.exp(-sigma), channel=channel)) < Z_LIMIT


def test_media_in_any_order_give_one_picture():
    """Three that overlap, among fibers."""
    media = [
        fog(BoxBound(lower_mm=(0, 0, 0), upper_mm=(1, 0.5, 1)), (2.0, 0.1, 0.1), IsotropicScattering()),
        fog(BallBound(position_mm=(0.4, 0.4, 0.4), radius_mm=0.4), (0.1, 3.0, 0.1)),
        fog(BallBound(position_mm=(0.6, 0.6, 0.6), radius_mm=0.4), 1.0, HenyeyGreensteinScattering(g=-0.4)),
    ]
    grids, phases = (random_grid((2, 2, 2), seed=42, peak=0.2),), {"a": TABLE["reference"]}
    pictures = [
        picture([media[i] for i in order], grids, phases, seed=seed, camera=PERSPECTIVE)
        for seed, order in enumerate([(0, 1, 2), (2, 0, 1)])
    ]
    for channel in range(3):
        assert abs(welch_z(*pictures, channel=channel)) < Z_LIMIT


@pytest.mark.parametrize(
    "options",
    [{"rounds_per_dispatch": 1, "lane_count": 64}, {"steps_per_round": 1, "blocks_per_pass": 1}],
    ids=str,
)
def test_no_scheduling_changes_a_bit_among_colored_media(options):
    media = [fog(BallBound(position_mm=(0.5, 0.4, 0.4), radius_mm=0.5), COLORS, IsotropicScattering())]
    grids, phases = (random_grid((2, 2, 2), seed=42, peak=0.2),), {"a": TABLE["reference"]}
    scene = {"camera": PERSPECTIVE, "samples_per_pixel": 5, "block_samples": 2, "resolution": (16, 16)}
    usual, other = (
        picture(media, grids, phases, options=KernelOptions(**one), **scene) for one in ({}, options)
    )
    for name, layer in usual.layers.items():
        np.testing.assert_array_equal(layer, other.layers[name], err_msg=name)


def test_paths_among_colored_media_go_on_in_another_kernel_with_the_same_bits():
    """Their state is taken in the middle of a pass, as a checkpoint does."""
    ball = fog(BallBound(position_mm=(0.5, 0.4, 0.4), radius_mm=0.5), COLORS, IsotropicScattering())
    config = RenderConfig(resolution=(16, 16), lights=[ConstantLight()], camera=PERSPECTIVE, media=[ball])
    scene = build_scene(config, volume(random_grid((2, 2, 2), seed=42, peak=0.2)), {"a": TABLE["reference"]})
    options = KernelOptions(lane_count=64, rounds_per_dispatch=2)
    work = Pass((0, 0, 16, 16), range(8))
    undisturbed, stopped, resumed = (Kernel(shared_context(), scene, options) for _ in range(3))
    expected = undisturbed.trace(work)
    stopped.begin(work)
    for _ in range(5):
        stopped.advance()
    assert stopped.busy
    assert resumed.restore(stopped.state())
    while resumed.busy:
        resumed.advance()
    np.testing.assert_array_equal(resumed.sums(), expected)
    for kernel in (undisturbed, stopped, resumed):
        kernel.release()


def test_a_grid_beside_the_volume(tmp_path):
    """Its density times an extinction by color, toward all directions alike."""
    pytest.importorskip("weft.voxelize._openvdb", reason="OpenVDB is not installed")
    from weft.voxelize.vdb import write_volume

    write_volume(tmp_path / "smoke.vdb", volume(uniform_grid((2, 2, 2), 0.5, (1.0, 0.0, 0.0))))
    smoke = GridMedium(file=tmp_path / "smoke.vdb", extinction_per_mm=COLORS, scattering=BLACK)
    result = picture([smoke])
    for channel, sigma in enumerate(COLORS):
        expected = math.exp(-0.5 * sigma * 16 * VOXEL_MM)
        assert abs(z_score(result, expected, channel=channel)) < Z_LIMIT


def test_what_cannot_be_is_refused(tmp_path):
    with pytest.raises(ValidationError, match="lower_mm must lie below"):
        BoxBound(lower_mm=(0, 0, 0), upper_mm=(1, 0, 1))
    with pytest.raises(ValidationError, match="media need tracking and shadow_tracking"):
        RenderConfig(media=[fog()], tracking="delta")
    with pytest.raises(InputError, match="9 homogeneous media"):
        picture([fog()] * 9)
    (tmp_path / "open.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(InputError, match="the bound of a medium is not closed"):
        picture([fog(MeshBound(file=tmp_path / "open.obj"))])
