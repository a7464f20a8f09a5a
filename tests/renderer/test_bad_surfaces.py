"""Meshes and textures that cannot be rendered are refused in one line."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from weft.files.errors import InputError
from weft.files.measured.merl import FILE_BYTES
from weft.renderer.config import RenderConfig
from weft.renderer.materials import read_texture
from weft.renderer.mesh import ground_triangles, load_mesh
from weft.renderer.surface_config import DiffuseMaterial, GroundSurface, MerlMaterial, MeshSurface
from weft.renderer.surface_files import check_surface_files

from .meshes import write_ball


def obj(tmp_path, text):
    (tmp_path / "m.obj").write_text(text)
    return tmp_path / "m.obj"


def test_a_missing_mesh(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        load_mesh(tmp_path / "m.obj")


def test_a_mesh_without_triangles(tmp_path):
    with pytest.raises(InputError, match="no triangles"):
        load_mesh(obj(tmp_path, "v 0 0 0\nv 1 0 0\n"))


def test_a_vertex_that_is_not_finite(tmp_path):
    with pytest.raises(InputError, match="vertex 1 has a coordinate that is not finite"):
        load_mesh(obj(tmp_path, "v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n"))


def test_triangles_without_area(tmp_path):
    line = "v 0 0 0\nv 1 0 0\nv 2 0 0\nv 0 1 0\n"
    with pytest.raises(InputError, match="all triangles are degenerate"):
        load_mesh(obj(tmp_path, line + "f 1 2 3\nf 1 1 4\n"))
    assert len(load_mesh(obj(tmp_path, line + "f 1 2 3\nf 1 2 4\n"))) == 1


def test_a_file_that_is_no_mesh(tmp_path):
    (tmp_path / "m.ply").write_bytes(b"not a mesh at all")
    with pytest.raises(InputError, match=r"not a readable mesh|no triangles"):
        load_mesh(tmp_path / "m.ply")


def test_a_missing_or_broken_texture(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_texture(tmp_path / "t.png")
    (tmp_path / "t.png").write_bytes(b"\x89PNG\r\n\x1a\nrubbish")
    with pytest.raises(InputError, match="not a readable picture"):
        read_texture(tmp_path / "t.png")


def test_a_ground_without_a_normal():
    with pytest.raises(InputError, match="normal is zero"):
        ground_triangles(GroundSurface(normal=(0, 0, 0)), np.array([[0.0, 0, 0], [1, 1, 1]]), 0)


def test_checking_a_scene_reads_each_file_once_and_refuses_the_missing(tmp_path):
    ball = write_ball(tmp_path, subdivisions=1)
    Image.new("RGB", (5, 4)).save(tmp_path / "t.png")
    paint = DiffuseMaterial(texture=tmp_path / "t.png")
    table = tmp_path / "m.binary"
    table.write_bytes(b"short")
    surfaces = [
        MeshSurface(file=ball, material=paint),
        MeshSurface(file=ball, material=paint),
        GroundSurface(material=MerlMaterial(file=table)),
    ]
    lines = check_surface_files(RenderConfig(surfaces=surfaces))
    assert next(lines) == (ball, "80 triangles")
    assert next(lines) == (tmp_path / "t.png", "5 x 4 pixels")
    with pytest.raises(InputError, match="Is it truncated"):
        next(lines)
    with open(table, "wb") as file:  # the header tells enough: no need to read 35 MB of zeros
        file.truncate(FILE_BYTES)
    with pytest.raises(InputError, match="0 x 0 x 0 cells"):
        list(check_surface_files(RenderConfig(surfaces=surfaces)))
