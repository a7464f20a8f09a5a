"""Instances: a mesh that stands in the scene many times looks as its copies do, and takes the room of one."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from PIL import Image

from weft.renderer import scene
from weft.renderer.balls import ball_triangles
from weft.renderer.config import ConstantLight, PerspectiveCamera, RenderConfig
from weft.renderer.instances import INSTANCED_FROM, instanced_meshes
from weft.renderer.kernel import KernelOptions
from weft.renderer.light_config import QuadLight
from weft.renderer.mesh import mesh_triangles
from weft.renderer.render import run
from weft.renderer.scene import IsotropicPhase
from weft.renderer.surface_config import (
    BallSurface,
    DiffuseMaterial,
    GroundSurface,
    MeshSurface,
    Placement,
    PrincipledMaterial,
)
from weft.renderer.surfaces import build_surface_table

from .meshes import write_ball
from .statistics import Z_LIMIT, welch_z, z_score
from .volumes import uniform_grid, volume

SPECK = volume(uniform_grid((1, 1, 1), 0.5, (1, 0, 0)))
NEVER = 10**9
TURNED = [
    Placement(position_mm=(3.0, 1.0, 0.0), scale=(0.5, 1.0, 0.7), rotation_deg=(20, 40, 60)),
    Placement(position_mm=(5.0, 0.8, -1.0), scale=0.6, rotation_deg=(0, 0, 90)),
    Placement(position_mm=(4.0, 0.5, 1.6), scale=(0.9, 0.3, 0.4), rotation_deg=(-50, 10, 0)),
]
BRUSHED = [
    Placement(position_mm=(2.4 + 1.3 * i, 2.2, -0.5), scale=(0.3, 0.5, 0.4), rotation_deg=(70 * i, 20, 50))
    for i in range(3)
]


def write_textured_ball(folder):
    """A ball with texture coordinates, whose tangents brushed metal follows."""
    ball = ball_triangles(BallSurface(), 0)
    lines = [f"v {x} {y} {z}" for x, y, z in ball.corners.reshape(-1, 3)]
    lines += [f"vt {u} {v}" for u, v in ball.uvs.reshape(-1, 2)]
    lines += [f"f {i}/{i} {i + 1}/{i + 1} {i + 2}/{i + 2}" for i in range(1, 3 * len(ball), 3)]
    (folder / "textured.obj").write_text("\n".join(lines))
    return folder / "textured.obj"


def surfaces(folder):
    file = write_ball(folder)
    pixels = np.random.default_rng(1).integers(0, 256, (8, 16, 3), np.uint8)
    Image.fromarray(pixels).save(folder / "t.png")
    brushed = PrincipledMaterial(color=(0.9, 0.6, 0.3), metallic=1.0, roughness=0.6, anisotropic=0.9)
    return [
        MeshSurface(file=write_textured_ball(folder), placements=BRUSHED, material=brushed, smooth=False),
        MeshSurface(file=file, placements=TURNED, material=PrincipledMaterial(color=(0.2, 0.4, 0.7))),
        MeshSurface(file=file, placements=[Placement(position_mm=(2.2, 0.4, 1.8), scale=0.4)], smooth=False),
        BallSurface(position_mm=(6.2, 0.7, 0.6), radius_mm=0.7, material=brushed),
        BallSurface(
            position_mm=(2.0, 0.6, -1.2),
            radius_mm=0.6,
            material=DiffuseMaterial(texture=folder / "t.png", color=(1, 1, 1)),
        ),
        GroundSurface(size_mm=30),
    ]


def picture(monkeypatch, found, least, **settings):
    """Rendered with instances of meshes that have at least so many triangles in all."""
    options = settings.pop("options", None)
    table = functools.partial(build_surface_table, instanced_from=least)
    monkeypatch.setattr(scene, "build_surface_table", table)
    defaults = {
        "resolution": (48, 24),
        "samples_per_pixel": 48,
        "max_bounces": 5,
        "lights": [
            ConstantLight(radiance=(0.4, 0.4, 0.4)),
            QuadLight(position_mm=(1, 6, 5), width_mm=2, height_mm=2, radiance=(9, 9, 9)),
        ],
        "surfaces": found,
        "camera": PerspectiveCamera(position_mm=(4, 4, 9), target_mm=(4.1, 0.5, 0), fov_deg=38),
    }
    return run(RenderConfig(**(defaults | settings)), SPECK, {"a": IsotropicPhase()}, options=options)


@pytest.mark.gl
def test_instances_look_as_copies_do(monkeypatch, tmp_path):
    """Sample by sample: with the same random numbers, pixels differ where rounding sends a path elsewhere."""
    one, other = (picture(monkeypatch, surfaces(tmp_path), least) for least in (1, NEVER))
    assert one.statistics.broken_samples == 0
    difference = np.abs(one.radiance - other.radiance).max(axis=-1)
    assert np.median(difference) < 1e-5
    assert np.quantile(difference, 0.99) < 5e-3
    for channel in range(3):
        assert abs(welch_z(one, other, channel=channel)) < 1  # far below chance: the samples are the same
    for name in ("Z", "N.X", "N.Y", "N.Z", "albedo.R"):
        assert np.quantile(np.abs(one.layers[name] - other.layers[name]), 0.98) < 1e-4


@pytest.mark.gl
def test_no_scheduling_changes_a_bit(monkeypatch, tmp_path):
    one, two = (
        picture(monkeypatch, surfaces(tmp_path), 1, samples_per_pixel=2, options=KernelOptions(**options))
        for options in ({}, {"rounds_per_dispatch": 1, "seeks_per_round": 1, "lane_count": 64})
    )
    np.testing.assert_array_equal(one.radiance, two.radiance)


@pytest.mark.gl
def test_white_furnace_of_instances(monkeypatch, tmp_path):
    """White bodies in white light cannot be seen: no ray meets the surface that it leaves."""
    white = MeshSurface(
        file=write_ball(tmp_path), placements=TURNED, material=DiffuseMaterial(color=(1, 1, 1)), smooth=False
    )
    result = picture(
        monkeypatch,
        [white],
        1,
        lights=[ConstantLight()],
        sampling="both_plain",
        background=(1.0, 1.0, 1.0),
        max_bounces=1000,
    )
    assert abs(z_score(result, 1.0)) < Z_LIMIT
    assert abs(float(result.radiance.mean()) - 1) < 2e-3


def test_normals_stay_across_an_unevenly_scaled_ball(tmp_path):
    """The gradient of (x/a)^2 + (y/b)^2 + (z/c)^2 at its corners."""
    scale = np.array([0.5, 2.0, 3.0])
    ball = MeshSurface(file=write_ball(tmp_path), placements=[Placement(scale=tuple(scale))])
    triangles = mesh_triangles(ball, 0)
    gradient = triangles.corners / scale**2
    gradient /= np.linalg.norm(gradient, axis=-1, keepdims=True)
    normals = triangles.normals / np.linalg.norm(triangles.normals, axis=-1, keepdims=True)
    assert (gradient * normals).sum(-1).min() > 0.999


def test_a_thousand_instances_take_the_room_of_one_mesh(tmp_path):
    file = write_ball(tmp_path)
    bounds, corner = np.array([[0.0, 0, 0], [1, 1, 1]]), np.zeros(3)
    places = [Placement(position_mm=(3.0 * i, 0, 0)) for i in range(1000)]
    many = build_surface_table([MeshSurface(file=file, placements=places)], [], bounds, corner, 0.1)
    one = build_surface_table([MeshSurface(file=file)], [], bounds, corner, 0.1)
    assert many.instance_count == 1000
    assert one.instance_count == 0
    assert many.triangle_count == one.triangle_count == 320
    assert len(many.rows) <= len(one.rows) + 1000 * (7 + 2 * 5)


def test_few_copies_stay_copies(tmp_path):
    file = write_ball(tmp_path)
    few = MeshSurface(file=file, placements=TURNED)
    assert instanced_meshes([few]) == ([], set())
    meshes, used = instanced_meshes([few, GroundSurface(), few], 320 * 6)
    assert [len(mesh.instances) for mesh in meshes] == [6]
    assert used == {0, 2}
    assert [one.material for one in meshes[0].instances] == [0, 0, 0, 2, 2, 2]
    assert INSTANCED_FROM > 320 * 3
