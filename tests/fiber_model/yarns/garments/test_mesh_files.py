"""Meshes from files: what is read, and what is refused in one line."""

import sys

import numpy as np
import pytest
import trimesh

from weft.fiber_model.yarns.garments.mesh_files import read_mesh
from weft.fiber_model.yarns.garments.surface_mesh import SurfaceMesh
from weft.files.errors import InputError

SQUARE = "v 0 0 0\nv 2 0 0\nv 2 1 0\nv 0 1 0\n"
SQUARE_UV = "vt 0 0\nvt 1 0\nvt 1 0.5\nvt 0 0.5\n"
USD = """#usda 1.0
( metersPerUnit = 0.01
  upAxis = "Z" )
def Xform "root" {
  double3 xformOp:translate = (0, 0, 10)
  uniform token[] xformOpOrder = ["xformOp:translate"]
  def Mesh "cloth" {
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(0,0,0), (2,0,0), (2,0,1), (0,0,1)]
    texCoord2f[] primvars:st = [(0,0), (1,0), (1,0.5), (0,0.5)] ( interpolation = "faceVarying" )
  }
}
"""


def write(path, text):
    path.write_text(text)
    return path


def test_obj_with_uv(tmp_path):
    text = SQUARE + SQUARE_UV + "f 1/1 2/2 3/3\nf 1/1 3/3 4/4\n"
    mesh = read_mesh(write(tmp_path / "cloth.obj", text), scale_to_mm=10.0)
    assert mesh.area == pytest.approx(200.0)
    assert mesh.uv is not None
    assert mesh.uv[..., 0] * 20 == pytest.approx(mesh.vertices[mesh.faces][..., 0])


def test_vertices_repeated_along_a_uv_seam_are_one(tmp_path):
    """One edge, two sets of UVs: the file's reader splits vertices, the mesh stays connected."""
    text = SQUARE + SQUARE_UV + "vt 5 5\nvt 6 6\nvt 5 6\nf 1/1 2/2 3/3\nf 1/5 3/6 4/7\n"
    mesh = read_mesh(write(tmp_path / "cloth.obj", text), scale_to_mm=1.0)
    assert len(mesh.vertices) == 4
    assert (mesh.twins() >= 0).sum() == 2


def test_z_up_is_turned(tmp_path):
    path = write(tmp_path / "cloth.obj", "v 0 0 0\nv 1 0 0\nv 0 0 1\nf 1 2 3\n")
    mesh = read_mesh(path, scale_to_mm=1.0, up_axis=2)
    assert np.ptp(mesh.vertices, axis=0) == pytest.approx([1, 1, 0])


@pytest.mark.parametrize("suffix", ["ply", "glb"])
def test_other_formats(tmp_path, suffix):
    box = trimesh.creation.box((1.0, 2.0, 3.0))
    box.export(tmp_path / f"box.{suffix}")
    mesh = read_mesh(tmp_path / f"box.{suffix}", scale_to_mm=10.0 if suffix == "ply" else None)
    scale = {"ply": 10.0, "glb": 1000.0}[suffix]
    assert np.ptp(mesh.vertices, axis=0) == pytest.approx(scale * np.array([1, 2, 3]), rel=1e-6)
    assert len(mesh.vertices) == 8
    assert (mesh.twins() >= 0).all()


def test_usd_units_axes_transforms_and_polygons(tmp_path):
    pytest.importorskip("pxr", reason="usd-core is an extra: pip install usd-core")
    mesh = read_mesh(write(tmp_path / "cloth.usda", USD))
    assert mesh.face_count == 2
    assert mesh.area == pytest.approx(200.0)
    assert mesh.vertices[:, 1].min() == pytest.approx(100.0)  # z of the stage, 10 cm up
    assert mesh.vertex_normals()[:, 2] == pytest.approx(1.0)  # -y of the stage looks toward +z
    assert mesh.uv is not None
    assert mesh.uv.reshape(-1, 2).max(axis=0) == pytest.approx([1, 0.5])


def test_the_shirt(shared_data):
    pytest.importorskip("pxr", reason="usd-core is an extra: pip install usd-core")
    mesh = read_mesh(shared_data / "garments" / "unisex_shirt.usd", scale_to_mm=10.0)
    assert mesh.face_count == 12736
    assert mesh.uv is None
    assert np.ptp(mesh.vertices, axis=0) == pytest.approx([651.2, 645.8, 274.8], abs=0.1)


def test_usd_without_its_library_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pxr", None)
    with pytest.raises(InputError, match=r"usd-core.*pip install usd-core"):
        read_mesh(write(tmp_path / "cloth.usda", USD))


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("none.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n", "no triangle mesh|cannot be read"),
        ("range.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "cannot be read|names vertices"),
        ("nan.obj", "v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n", "not finite|cannot be read"),
        ("flat.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "without area"),
        ("text.ply", "this is no mesh", "cannot be read"),
        ("text.glb", "this is no mesh", "cannot be read"),
        ("broken.gltf", "{", "cannot be read"),
        ("far.obj", "v 0 0 0\nv 1e30 0 0\nv 0 1 0\nf 1 2 3\n", "ten kilometers"),
    ],
)
def test_bad_files_are_refused_by_name(tmp_path, name, text, message):
    with pytest.raises(InputError, match=message) as caught:
        read_mesh(write(tmp_path / name, text), scale_to_mm=1.0)
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "text", ["#usda 1.0\n", "no stage", USD.replace("[4]", "[5]"), USD.replace("2, 3]", "2, 9]")]
)
def test_bad_stages_are_refused(tmp_path, text):
    pytest.importorskip("pxr", reason="usd-core is an extra: pip install usd-core")
    with pytest.raises(InputError, match=r"bad\.usda"):
        read_mesh(write(tmp_path / "bad.usda", text))


@pytest.mark.parametrize(
    ("vertices", "faces", "uv", "message"),
    [
        (np.zeros((0, 3)), np.zeros((0, 3)), None, "no triangles"),
        (np.eye(3), [[0, 1, 3]], None, "triangle 0 names vertices 0, 1, 3, but there are 3"),
        (np.eye(3), [[0, 1, -1]], None, "triangle 0 names vertices"),
        (np.eye(3) * np.nan, [[0, 1, 2]], None, "vertex 0 of the mesh is not finite"),
        (np.eye(3), [[0, 1, 2]], np.zeros((2, 3, 2)), "surface coordinates have shape"),
        (np.eye(3), [[0, 1, 2]], np.full((1, 3, 2), np.inf), "triangle 0 are not finite"),
    ],
)
def test_bad_meshes_are_refused(vertices, faces, uv, message):
    with pytest.raises(InputError, match=message):
        SurfaceMesh.checked(vertices, np.asarray(faces), uv)
