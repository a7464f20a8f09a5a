"""A ball and a ground around a volume, under lights of seven kinds, look as in Mitsuba 3."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.peers.compared_pictures import (
    PeerImage,
    mitsuba_image,
    perspective_sensor,
    threshold,
    weft_image,
    welch,
)
from weft.renderer.config import ConstantLight, DirectionalLight, PerspectiveCamera, RenderConfig
from weft.renderer.light_config import DiskLight, MeshLight, PointLight, QuadLight, SpotLight
from weft.renderer.scene import IsotropicPhase
from weft.renderer.surface_config import DiffuseMaterial, GroundSurface, MeshSurface, Placement

from .meshes import write_ball
from .volumes import VOXEL_MM, brick_origins, volume

pytestmark = pytest.mark.gl

SIZE, TILE = 48, 8
SUN, SUN_IRRADIANCE = (1.0, 2.0, 0.5), 2.0
POSITION, TARGET, FOV = (2.5, 3.0, 4.0), (0.7, 0.2, 0.4), 30.0
GROUND, BALL = (0.3, 0.6, 0.8), (0.8, 0.5, 0.2)
POINT, POINT_INTENSITY = (-0.3, 0.6, 1.2), 0.5
SPOT, SPOT_INTENSITY, SPOT_BEAM, SPOT_CUTOFF = (1.5, 2.0, 2.0), 4.0, 8.0, 15.0
QUAD_AT, QUAD_RADIANCE, QUAD_SIZE = (0.4, 1.3, -0.3), 3.0, (0.8, 0.4)
LAMP_AT, LAMP_RADIANCE, LAMP_RADIUS = (0.0, 0.5, 1.3), 4.0, 0.1
DISK_AT, DISK_RADIANCE, DISK_RADIUS = (2.3, 0.6, 0.9), 2.0, 0.3
MIDDLE = (0.4, 0.4, 0.4)
"""What the lights that have a direction face: the middle of the volume."""
BALL_AT, BALL_RADIUS = (1.6, 0.35, 0.3), 0.35


def blobs(seed=7):
    """Two bricks a side of smooth extinction between 0 and 12 per mm."""
    from weft.voxelize.grid import FiberGrid

    rng = np.random.default_rng(seed)
    density = (12 * rng.random((8, 512)) * (rng.random((8, 512)) < 0.4)).astype(np.float32)
    axis = np.zeros((8, 512, 3), np.float32)
    axis[..., 0] = density > 0
    return FiberGrid(VOXEL_MM, 0.01, brick_origins((2, 2, 2)), density, axis)


def weft_picture(folder, grid) -> PeerImage:
    config = RenderConfig(
        resolution=(SIZE, SIZE),
        samples_per_pixel=512,
        seed=3,
        max_bounces=1000,
        camera=PerspectiveCamera(position_mm=POSITION, target_mm=TARGET, fov_deg=FOV),
        lights=[
            ConstantLight(radiance=(0.3,) * 3),
            DirectionalLight(direction=SUN, irradiance=(SUN_IRRADIANCE,) * 3),
            PointLight(position_mm=POINT, intensity=(POINT_INTENSITY,) * 3),
            SpotLight(
                position_mm=SPOT,
                intensity=(SPOT_INTENSITY,) * 3,
                beam_deg=SPOT_BEAM,
                cutoff_deg=SPOT_CUTOFF,
            ),
            QuadLight(
                position_mm=QUAD_AT,
                radiance=(QUAD_RADIANCE,) * 3,
                width_mm=QUAD_SIZE[0],
                height_mm=QUAD_SIZE[1],
            ),
            MeshLight(
                file=write_ball(folder, name="lamp.obj", subdivisions=1, radius=LAMP_RADIUS),
                placement=Placement(position_mm=LAMP_AT),
                radiance=(LAMP_RADIANCE,) * 3,
            ),
            DiskLight(position_mm=DISK_AT, radiance=(DISK_RADIANCE,) * 3, radius_mm=DISK_RADIUS),
        ],
        background="environment",
        extinction="isotropic",
        isotropic_extinction_per_mm=1.0,
        surfaces=[
            GroundSurface(size_mm=8, material=DiffuseMaterial(color=GROUND)),
            MeshSurface(
                file=write_ball(folder, radius=BALL_RADIUS),
                material=DiffuseMaterial(color=BALL),
                placements=[Placement(position_mm=BALL_AT)],
                smooth=False,
            ),
        ],
    )
    return weft_image(config, volume(grid), {"a": IsotropicPhase((0.9,) * 3)})


def mitsuba_scene(mi, folder, grid) -> dict:
    transform = mi.ScalarTransform4f
    half = VOXEL_MM * 8
    values = np.zeros((16, 16, 16), np.float32)
    for place, density in zip(grid.origins, grid.density, strict=True):
        values[tuple(slice(p, p + 8) for p in place)] = density.reshape(8, 8, 8)
    write_ball(folder, name="ball.ply", radius=BALL_RADIUS)
    write_ball(folder, name="lamp.ply", subdivisions=1, radius=LAMP_RADIUS)

    def facing(position):
        return transform().look_at(origin=list(position), target=list(MIDDLE), up=[0, 1, 0])

    def diffuse(color):
        return {
            "type": "twosided",
            "b": {"type": "diffuse", "reflectance": {"type": "rgb", "value": list(color)}},
        }

    return {
        "type": "scene",
        "integrator": {"type": "volpath", "max_depth": 1000, "rr_depth": 1000},
        "sky": {"type": "constant", "radiance": 0.3},
        "sun": {"type": "directional", "direction": [-x for x in SUN], "irradiance": SUN_IRRADIANCE},
        "point": {"type": "point", "position": list(POINT), "intensity": POINT_INTENSITY},
        "spot": {
            "type": "spot",
            "to_world": facing(SPOT),
            "intensity": SPOT_INTENSITY,
            "beam_width": SPOT_BEAM,
            "cutoff_angle": SPOT_CUTOFF,
        },
        "quad": {
            "type": "rectangle",
            "to_world": facing(QUAD_AT).scale([QUAD_SIZE[0] / 2, QUAD_SIZE[1] / 2, 1]),
            "bsdf": {"type": "diffuse", "reflectance": 0.0},
            "emitter": {"type": "area", "radiance": QUAD_RADIANCE},
        },
        "disk": {
            "type": "disk",
            "to_world": facing(DISK_AT).scale(DISK_RADIUS),
            "bsdf": {"type": "diffuse", "reflectance": 0.0},
            "emitter": {"type": "area", "radiance": DISK_RADIANCE},
        },
        "lamp": {
            "type": "ply",
            "filename": str(folder / "lamp.ply"),
            "face_normals": True,
            "to_world": transform().translate(list(LAMP_AT)),
            "bsdf": {"type": "diffuse", "reflectance": 0.0},
            "emitter": {"type": "area", "radiance": LAMP_RADIANCE},
        },
        "ground": {
            "type": "rectangle",
            "to_world": transform().translate([half, 0, half]).rotate([1, 0, 0], -90).scale(4.0),
            "bsdf": diffuse(GROUND),
        },
        "ball": {
            "type": "ply",
            "filename": str(folder / "ball.ply"),
            "face_normals": True,
            "to_world": transform().translate(list(BALL_AT)),
            "bsdf": diffuse(BALL),
        },
        "block": {
            "type": "cube",
            # a thousandth of a millimeter above the ground, which it would share a face with
            "to_world": transform().translate([half, half + 1e-3, half]).scale(half),
            "bsdf": {"type": "null"},
            "interior": {
                "type": "heterogeneous",
                "sigma_t": {
                    "type": "gridvolume",
                    "grid": mi.VolumeGrid(np.ascontiguousarray(values.transpose(2, 1, 0)[..., None])),
                    "filter_type": "nearest",
                    "to_world": transform().translate([0, 1e-3, 0]).scale(2 * half),
                },
                "albedo": 0.9,
                "phase": {"type": "isotropic"},
            },
        },
        "sensor": perspective_sensor(mi, position=POSITION, target=TARGET, fov_deg=FOV, size=SIZE),
    }


@pytest.fixture(scope="module")
def images(tmp_path_factory):
    pytest.importorskip("mitsuba", reason="Mitsuba 3 is not installed")
    folder, grid = tmp_path_factory.mktemp("ball"), blobs()
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    theirs = mitsuba_image(mi, mitsuba_scene(mi, folder, grid), runs=8, samples=56, seed=100)
    return weft_picture(folder, grid), theirs


def test_the_whole_picture_agrees_with_mitsuba(images):
    weft, mitsuba = images
    relative_error = math.sqrt(weft.variance.sum() + mitsuba.variance.sum()) / mitsuba.mean.sum()
    assert relative_error < 1e-3, "too few samples to see a bias of half a percent"
    assert np.abs(welch(weft, mitsuba, SIZE)).max() < threshold(3)


def test_every_tile_agrees_with_mitsuba(images):
    z = welch(*images, TILE)
    assert np.abs(z).max() < threshold(z.size)
    assert 0.6 < z[np.abs(z) > 1e-9].std() < 1.5, "differences should be as large as their standard errors"
