"""Voxels as large as the camera's pixels, where the cloth is nearest to it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from weft.files.errors import InputError
from weft.pipeline.camera_voxels import camera_settings, sized_by_camera
from weft.pipeline.config import load
from weft.voxelize.config import VoxelizeConfig

JOB = """
[fibers]
preset = "cotton2"
[voxelize]
voxels_per_pixel = {voxels}
[render]
resolution = [200, 100]
"""
CAMERA = """
[render.camera]
kind = "{kind}"
{place}
"""


def cloth(*corners):
    """Fibers of which only the boxes are asked for."""
    boxes = np.array([[corner, np.add(corner, 1)] for corner in corners], np.float32)
    return SimpleNamespace(stretch_bounds=lambda: boxes)


def size(tmp_path, fibers, *, kind: str, place: str, voxels: float = 1.0) -> float:
    path = tmp_path / "a.toml"
    path.write_text(JOB.format(voxels=voxels) + CAMERA.format(kind=kind, place=place))
    return sized_by_camera(load(path), fibers).size_mm


@pytest.mark.parametrize("voxels", [1.0, 2.5])
def test_a_pixel_holds_so_many_voxels(tmp_path, voxels):
    place = "position_mm = [0.5, 0.5, 41.0]\ntarget_mm = [0.5, 0.5, 0.0]\nfov_deg = 40.0"
    pixel = 2 * 40 * np.tan(np.radians(20)) / 200
    made = size(tmp_path, cloth((0, 0, 0)), kind="perspective", place=place, voxels=voxels)
    assert 0.99 * pixel / voxels < made <= pixel / voxels


def test_what_is_not_in_view_does_not_count(tmp_path):
    """Nearer, but behind the camera, or beside the picture."""
    place = "position_mm = [0.5, 0.5, 41.0]\ntarget_mm = [0.5, 0.5, 0.0]\nfov_deg = 40.0"
    alone = size(tmp_path, cloth((0, 0, 0)), kind="perspective", place=place)
    others = cloth((0, 0, 0), (0, 0, 60), (30, 0, 20), (0, 20, 20))
    assert size(tmp_path, others, kind="perspective", place=place) == alone
    assert size(tmp_path, cloth((0, 0, 0), (0, 0, 20)), kind="perspective", place=place) < 0.6 * alone


def test_an_orthographic_camera_sees_all_alike(tmp_path):
    place = "frame_width_mm = 30.0"
    made = size(tmp_path, cloth((0, 0, 0), (0, 0, 9)), kind="orthographic", place=place)
    assert made == pytest.approx(30 / 200)


def test_the_finest_of_several_cameras_decides(tmp_path):
    path = tmp_path / "a.toml"
    cameras = "".join(
        f'[[render.cameras]]\nkind = "orthographic"\nname = "{name}"\nframe_width_mm = {width}\n'
        for name, width in (("near", 10.0), ("far", 40.0))
    )
    path.write_text(JOB.format(voxels=1.0) + cameras)
    assert sized_by_camera(load(path), cloth((0, 0, 0))).size_mm == pytest.approx(10 / 200)


def test_cameras_without_an_answer_are_refused(tmp_path):
    among = "position_mm = [0.5, 0.5, 0.5]\ntarget_mm = [0.5, 0.5, -9.0]"
    with pytest.raises(InputError, match="among the fibers"):
        size(tmp_path, cloth((0, 0, 0)), kind="perspective", place=among)
    away = "position_mm = [0.5, 0.5, 20.0]\ntarget_mm = [0.5, 0.5, 30.0]"
    with pytest.raises(InputError, match="no fiber is in view"):
        size(tmp_path, cloth((0, 0, 0)), kind="perspective", place=away)
    path = tmp_path / "b.toml"
    path.write_text("[voxelize]\nvoxels_per_pixel = 1\n")
    with pytest.raises(InputError, match="needs the table"):
        sized_by_camera(load(path), cloth((0, 0, 0)))


def test_the_grid_is_stale_with_the_camera_only_where_it_decides(tmp_path):
    path = tmp_path / "a.toml"
    path.write_text(JOB.format(voxels=1.0))
    assert camera_settings(load(path))["render.resolution"] == (200, 100)
    assert camera_settings(load(path, ["render.samples_per_pixel=3"])) == camera_settings(load(path))
    path.write_text("[voxelize]\nvoxel_size_mm = 1\n[render]\n")
    assert camera_settings(load(path)) == {}


def test_sizes_are_rounded_down_to_three_digits():
    config = VoxelizeConfig(voxels_per_pixel=1.0)
    assert [config.seen_by(pixel).size_mm for pixel in (0.123456, 1.0, 0.0999999)] == [0.123, 1.0, 0.0999]
