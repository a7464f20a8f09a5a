"""The mesh that bounds a volume: what lies outside is gone, what lies inside is as before."""

from __future__ import annotations

import math

import numpy as np
import pytest

from weft.files.errors import InputError
from weft.renderer.config import ConstantLight, RenderConfig
from weft.renderer.render import run
from weft.renderer.scene import IsotropicPhase
from weft.renderer.stencil import cut_out, inside_of_voxels
from weft.renderer.surface_config import Placement, Stencil

from .meshes import write_ball
from .volumes import VOXEL_MM, brick_origins, random_grid, volume


def box_file(folder, extents=(1.0, 1.0, 1.0)):
    import trimesh

    trimesh.creation.box(extents=extents).export(folder / "box.obj")
    return folder / "box.obj"


def test_a_ball_of_voxels_has_the_volume_of_the_mesh():
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=3, radius=19.3)
    ball.apply_translation([24.2, 23.9, 24.4])
    inside = inside_of_voxels(brick_origins((6, 6, 6)), ball.triangles)
    assert inside.sum() == pytest.approx(ball.volume, rel=3e-3)


def test_a_torus_keeps_its_hole():
    import trimesh

    ring = trimesh.creation.torus(major_radius=14, minor_radius=5)
    ring.apply_transform(trimesh.transformations.rotation_matrix(0.7, [1, 2, 0.5]))
    inside = inside_of_voxels(brick_origins((6, 6, 6)), ring.triangles + 24.0)
    assert inside.sum() == pytest.approx(ring.volume, rel=1e-2)
    middle = brick_origins((6, 6, 6)).tolist().index([24, 24, 24])
    assert not inside[middle, 0]


def test_a_box_on_voxel_faces_keeps_exactly_its_voxels(tmp_path):
    """24 x 8 x 16 voxels of 32 x 16 x 16: three bricks of four, one of two, all of two."""
    whole = volume(random_grid((4, 2, 2), seed=3, fill=0.6))
    size = np.array([24, 8, 16]) * VOXEL_MM
    stencil = Stencil(file=box_file(tmp_path, size), placement=Placement(position_mm=tuple(size / 2)))
    cut = cut_out(whole, stencil).grids["a"]
    grid = whole.grids["a"]
    kept = (grid.origins < [24, 8, 16]).all(axis=1)
    np.testing.assert_array_equal(cut.origins, grid.origins[kept])
    np.testing.assert_array_equal(cut.density, grid.density[kept])
    np.testing.assert_array_equal(cut.direction, grid.direction[kept])
    cut.check_values()


@pytest.mark.gl
def test_a_cut_picture_is_that_of_the_cut_volume(tmp_path):
    whole = volume(random_grid((2, 2, 2), seed=3, fill=0.6))
    stencil = Stencil(file=write_ball(tmp_path, radius=0.3), placement=Placement(position_mm=(0.4, 0.4, 0.4)))
    config = RenderConfig(resolution=(12, 12), samples_per_pixel=8, lights=[ConstantLight()], stencil=stencil)
    plain = config.model_copy(update={"stencil": None})
    one = run(config, whole, {"a": IsotropicPhase()})
    two = run(plain, cut_out(whole, stencil), {"a": IsotropicPhase()})
    np.testing.assert_array_equal(one.radiance, two.radiance)
    assert one.radiance.max() > 0
    inside = cut_out(whole, stencil).grids["a"].voxel_count / whole.grids["a"].voxel_count
    assert inside == pytest.approx(4 / 3 * math.pi * 0.3**3 / 0.8**3, rel=0.1)


def test_an_open_mesh_and_one_beside_the_volume_are_refused(tmp_path):
    whole = volume(random_grid((1, 1, 1), seed=3))
    (tmp_path / "open.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(InputError, match="the stencil mesh is not closed"):
        cut_out(whole, Stencil(file=tmp_path / "open.obj"))
    beside = Stencil(file=box_file(tmp_path), placement=Placement(position_mm=(9, 9, 9)))
    with pytest.raises(InputError, match="no fiber lies inside of the stencil mesh"):
        cut_out(whole, beside)
