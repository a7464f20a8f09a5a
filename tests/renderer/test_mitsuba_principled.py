"""Principled metals, brushed and plain, and a diffuse ball look as in Mitsuba 3; other lobes alone.

Mitsuba's `principled` has Burley's terms of 2012 for metals, base color, subsurface ("flatness") and sheen.
Its dielectric reflection is Fresnel's own where Burley has Schlick's approximation (up to 25 % between them),
and its clearcoat divides by other cosines: these two cannot be compared.
"""

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
from weft.renderer.light_config import PointLight, QuadLight
from weft.renderer.scene import IsotropicPhase
from weft.renderer.surface_config import (
    DiffuseMaterial,
    GroundSurface,
    MeshSurface,
    Placement,
    PrincipledMaterial,
)

from .meshes import write_ball
from .principled_reference import NAMES, principled
from .volumes import uniform_grid, volume

SIZE, TILE = 48, 8
COLOR = (0.7, 0.4, 0.1)
USUAL = dict(zip(NAMES, (0.0, 0.0, 0.5, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0, 1.0), strict=True))
MITSUBA_NAMES = {"subsurface": "flatness", "specular_tint": "spec_tint"}
POSITION, TARGET, FOV = (0.0, 2.5, 6.0), (0.0, 0.3, 0.0), 34.0
SUN, SUN_IRRADIANCE = (-1.0, 2.0, 0.5), 1.5
QUAD_AT, QUAD_RADIANCE = (0.0, 3.0, -1.0), 3.0
POINT, POINT_INTENSITY = (2.0, 2.0, 2.0), 3.0
BALLS = {
    -1.3: PrincipledMaterial(color=COLOR, metallic=1.0, roughness=0.45),
    0.0: DiffuseMaterial(color=COLOR),
    1.3: PrincipledMaterial(color=(0.9, 0.9, 0.9), metallic=1.0, roughness=0.7),
}
GROUND = PrincipledMaterial(color=(0.4, 0.5, 0.6), metallic=1.0, roughness=0.6, anisotropic=0.8)
RADIUS = 0.5


def mitsuba_principled(numbers: dict[str, float], color=COLOR) -> dict:
    named = {MITSUBA_NAMES.get(name, name): value for name, value in numbers.items()}
    return {"type": "principled", "base_color": {"type": "rgb", "value": list(color)}, **named}


def mitsuba_value(mi, numbers, wo, wi):
    """BRDF times cosine of pairs of directions, shape [n, 3]."""
    bsdf, context = mi.load_dict(mitsuba_principled(numbers)), mi.BSDFContext()
    values = []
    for one, other in zip(wo, wi, strict=True):
        hit = mi.SurfaceInteraction3f()
        hit.wi, hit.sh_frame = mi.Vector3f(one), mi.Frame3f(mi.Vector3f(0, 0, 1))
        values.append(np.array(bsdf.eval(context, hit, mi.Vector3f(other))))
    return np.array(values)


@pytest.fixture(scope="module")
def mi():
    module = pytest.importorskip("mitsuba", reason="Mitsuba 3 is not installed")
    module.set_variant("scalar_rgb")
    return module


@pytest.fixture(scope="module")
def directions():
    w = np.random.default_rng(5).normal(size=(2, 300, 3))
    w /= np.linalg.norm(w, axis=-1, keepdims=True)
    w[..., 2] = np.abs(w[..., 2])
    return w


@pytest.mark.parametrize(
    "change",
    [{"roughness": 0.2}, {"roughness": 0.8}, {"roughness": 0.5, "anisotropic": 0.9}],
    ids=["smooth", "rough", "brushed"],
)
def test_metals_are_those_of_mitsuba(mi, directions, change):
    wo, wi = directions
    numbers = USUAL | {"metallic": 1.0} | change
    ours = principled(COLOR, numbers, wo, wi) * wi[:, 2:]
    np.testing.assert_allclose(mitsuba_value(mi, numbers, wo, wi), ours, rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("name", ["sheen", "subsurface"])
@pytest.mark.parametrize("metallic", [0.0, 0.6])
def test_what_a_lobe_adds_is_what_it_adds_in_mitsuba(mi, directions, name, metallic):
    wo, wi = directions
    without = USUAL | {"metallic": metallic}
    added = without | {name: 0.8}
    ours = (principled(COLOR, added, wo, wi) - principled(COLOR, without, wo, wi)) * wi[:, 2:]
    theirs = mitsuba_value(mi, added, wo, wi) - mitsuba_value(mi, without, wo, wi)
    np.testing.assert_allclose(theirs, ours, rtol=1e-2, atol=1e-5)


def weft_picture(folder) -> PeerImage:
    file = write_ball(folder, subdivisions=3, radius=RADIUS)
    balls = [
        MeshSurface(file=file, material=m, smooth=False, placements=[Placement(position_mm=(x, RADIUS, 0))])
        for x, m in BALLS.items()
    ]
    config = RenderConfig(
        resolution=(SIZE, SIZE),
        samples_per_pixel=512,
        seed=9,
        max_bounces=1000,
        camera=PerspectiveCamera(position_mm=POSITION, target_mm=TARGET, fov_deg=FOV),
        lights=[
            ConstantLight(radiance=(0.3,) * 3),
            DirectionalLight(direction=SUN, irradiance=(SUN_IRRADIANCE,) * 3),
            PointLight(position_mm=POINT, intensity=(POINT_INTENSITY,) * 3),
            QuadLight(
                position_mm=QUAD_AT,
                target_mm=(0, 0, 0),
                width_mm=1.5,
                height_mm=1.0,
                radiance=(QUAD_RADIANCE,) * 3,
            ),
        ],
        background="environment",
        surfaces=[*balls, GroundSurface(size_mm=8, gap_mm=0.0, material=GROUND)],
    )
    # all but transparent: the stage wants a volume
    speck = volume(uniform_grid((1, 1, 1), 1e-9, (1, 0, 0)))
    return weft_image(config, speck, {"a": IsotropicPhase()})


def mitsuba_material(material) -> dict:
    if isinstance(material, DiffuseMaterial):
        inside = {"type": "diffuse", "reflectance": {"type": "rgb", "value": list(material.color)}}
    else:
        inside = mitsuba_principled({name: getattr(material, name) for name in NAMES}, material.color)
    return {"type": "twosided", "b": inside}


def mitsuba_picture(mi, folder) -> PeerImage:
    transform = mi.ScalarTransform4f
    write_ball(folder, name="ball.ply", subdivisions=3, radius=RADIUS)
    balls = {
        f"ball{i}": {
            "type": "ply",
            "filename": str(folder / "ball.ply"),
            "face_normals": True,
            "to_world": transform().translate([x, RADIUS, 0]),
            "bsdf": mitsuba_material(material),
        }
        for i, (x, material) in enumerate(BALLS.items())
    }
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 1000, "rr_depth": 1000},
        "sky": {"type": "constant", "radiance": 0.3},
        "sun": {"type": "directional", "direction": [-x for x in SUN], "irradiance": SUN_IRRADIANCE},
        "point": {"type": "point", "position": list(POINT), "intensity": POINT_INTENSITY},
        "quad": {
            "type": "rectangle",
            "to_world": transform()
            .look_at(origin=list(QUAD_AT), target=[0, 0, 0], up=[0, 1, 0])
            .scale([0.75, 0.5, 1]),
            "bsdf": {"type": "diffuse", "reflectance": 0.0},
            "emitter": {"type": "area", "radiance": QUAD_RADIANCE},
        },
        "ground": {
            "type": "rectangle",
            "to_world": transform().translate([0.2, 0, 0.2]).rotate([1, 0, 0], -90).scale(4.0),
            "bsdf": mitsuba_material(GROUND),
        },
        **balls,
        "sensor": perspective_sensor(mi, position=POSITION, target=TARGET, fov_deg=FOV, size=SIZE),
    }
    return mitsuba_image(mi, scene, runs=8, samples=64, seed=300)


@pytest.fixture(scope="module")
def images(mi, tmp_path_factory):
    folder = tmp_path_factory.mktemp("metal")
    return weft_picture(folder), mitsuba_picture(mi, folder)


@pytest.mark.gl
def test_the_whole_picture_agrees_with_mitsuba(images):
    weft, mitsuba = images
    relative_error = math.sqrt(weft.variance.sum() + mitsuba.variance.sum()) / mitsuba.mean.sum()
    assert relative_error < 1.5e-3, "too few samples to see a bias of half a percent"
    assert np.abs(welch(weft, mitsuba, SIZE)).max() < threshold(3)


@pytest.mark.gl
def test_every_tile_agrees_with_mitsuba(images):
    z = welch(*images, TILE)
    assert np.abs(z).max() < threshold(z.size)
    assert 0.6 < z[np.abs(z) > 1e-9].std() < 1.5, "differences should be as large as their standard errors"
