"""Damaged meshes: one clear line or a valid mesh, in little memory and time."""

import base64
import json
import subprocess

import numpy as np
import pytest
import trimesh

from tests.fiber_model.yarns.formats.forks import MOST_SECONDS, in_forks
from tests.fiber_model.yarns.formats.mutants import read_mutants
from weft.fiber_model.yarns.garments import usd_mesh_stage
from weft.fiber_model.yarns.garments.mesh_files import read_mesh
from weft.fiber_model.yarns.garments.surface_mesh import SurfaceMesh
from weft.files.errors import InputError


def sphere():
    """80 triangles with (u, v)."""
    ball = trimesh.creation.icosphere(subdivisions=1)
    uv = np.random.default_rng(0).random((len(ball.vertices), 2))
    visual = trimesh.visual.TextureVisuals(uv=uv, material=trimesh.visual.material.PBRMaterial())
    return trimesh.Trimesh(ball.vertices, ball.faces, process=False, visual=visual)


def gltf_with_data_inside():
    files = trimesh.exchange.gltf.export_gltf(trimesh.Scene(sphere()))
    tree = json.loads(files["model.gltf"])
    for buffer in tree["buffers"]:
        data = base64.b64encode(files[buffer["uri"]]).decode()
        buffer["uri"] = "data:application/octet-stream;base64," + data
    return json.dumps(tree).encode()


def usda():
    ball = sphere()
    points = ", ".join(f"({x:g}, {y:g}, {z:g})" for x, y, z in ball.vertices)
    index = ", ".join(map(str, ball.faces.ravel()))
    uv = ", ".join(f"({u:g}, {v:g})" for u, v in ball.visual.uv)
    return (
        '#usda 1.0\n(\n  metersPerUnit = 0.01\n  upAxis = "Y"\n)\ndef Mesh "ball" {\n'
        f"  int[] faceVertexCounts = [{', '.join(['3'] * len(ball.faces))}]\n"
        f"  int[] faceVertexIndices = [{index}]\n  point3f[] points = [{points}]\n"
        f'  texCoord2f[] primvars:st = [{uv}] ( interpolation = "vertex" )\n}}\n'
    ).encode()


def whole_file(name):
    match name:
        case "ball.obj":
            return trimesh.exchange.obj.export_obj(sphere()).encode()
        case "ball.ply":
            return trimesh.exchange.ply.export_ply(sphere())
        case "ascii.ply":
            return trimesh.exchange.ply.export_ply(sphere(), encoding="ascii")
        case "ball.glb":
            return trimesh.exchange.gltf.export_glb(trimesh.Scene(sphere()))
        case _:
            return gltf_with_data_inside()


@pytest.mark.filterwarnings("ignore")  # numpy's, of overflows in coordinates of 1e30
@pytest.mark.parametrize("name", ["ball.obj", "ball.ply", "ascii.ply", "ball.glb", "ball.gltf"])
@pytest.mark.parametrize("count", [150, pytest.param(500, marks=pytest.mark.proof)])
def test_mutants(tmp_path, name, count):
    options = {} if "gl" in name else {"scale_to_mm": 1.0}
    whole = whole_file(name)
    path = tmp_path / name
    path.write_bytes(whole)
    assert read_mesh(path, **options).face_count == 80
    refused, good = read_mutants(
        lambda path: read_mesh(path, **options),
        whole,
        tmp_path / f"mutant.{name}",
        count=count,
        kind=SurfaceMesh,
    )
    assert refused + good == count
    assert good > count // 25


@pytest.mark.proof
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("suffix", ["usda", "usdc"])
def test_mutants_of_usd(tmp_path, monkeypatch, suffix):
    """USD reads in a process with limits; here in forks, which start faster."""
    pytest.importorskip("pxr", reason="usd-core is an extra: pip install usd-core")
    from pxr import Usd

    monkeypatch.setattr(subprocess, "run", in_forks(usd_mesh_stage.main))
    text = tmp_path / "ball.usda"
    text.write_bytes(usda())
    binary = tmp_path / "ball.usdc"
    stage = Usd.Stage.Open(str(text))
    stage.GetRootLayer().Export(str(binary))
    path = text if suffix == "usda" else binary
    assert read_mesh(path).face_count == 80
    monkeypatch.setattr("tests.fiber_model.yarns.formats.mutants.MOST_SECONDS", MOST_SECONDS)
    mutant = tmp_path / f"mutant.{suffix}"
    refused, good = read_mutants(read_mesh, path.read_bytes(), mutant, count=250, kind=SurfaceMesh)
    assert refused + good == 250
    assert min(refused, good) > 0


def test_a_chunk_beyond_the_end_of_a_glb_is_refused_before_it_is_taken(tmp_path):
    data = bytearray(whole_file("ball.glb"))
    data[12:16] = (0x7FFFFFF0).to_bytes(4, "little")
    path = tmp_path / "huge.glb"
    path.write_bytes(data)
    with pytest.raises(InputError, match="a chunk of 2147483632 bytes does not fit"):
        read_mesh(path)


def test_an_array_larger_than_the_data_of_a_gltf_is_refused(tmp_path):
    tree = json.loads(gltf_with_data_inside())
    for accessor in tree["accessors"]:
        accessor.pop("bufferView")
        accessor["count"] = 10**12
    path = tmp_path / "huge.gltf"
    path.write_text(json.dumps(tree))
    with pytest.raises(InputError, match="accessor 0 has the count 1000000000000"):
        read_mesh(path)


@pytest.mark.parametrize("element", ["vertex", "face"])
@pytest.mark.parametrize("name", ["ball.ply", "ascii.ply"])
def test_a_huge_count_in_a_ply_is_refused(tmp_path, name, element):
    lines = whole_file(name).split(b"\n")
    huge = [f"element {element} 99999999999".encode() if element.encode() in line and line.startswith(b"el")
            else line for line in lines]  # fmt: skip
    path = tmp_path / name
    path.write_bytes(b"\n".join(huge))
    with pytest.raises(InputError, match=f"99999999999 of '{element}'"):
        read_mesh(path, scale_to_mm=1.0)


def test_a_missing_buffer_of_a_gltf_is_named(tmp_path):
    files = trimesh.exchange.gltf.export_gltf(trimesh.Scene(sphere()))
    path = tmp_path / "ball.gltf"
    path.write_bytes(files["model.gltf"])
    with pytest.raises(InputError, match=r"needs the file '.*\.bin', which is not there"):
        read_mesh(path)
