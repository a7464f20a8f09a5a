"""Every file can be looked into, and a damaged one is refused in one line."""

from __future__ import annotations

import json

import numpy as np
import pytest

from weft.fiber_model.scattering.parameters import FiberScatteringParameters
from weft.fiber_model.yarns.yarn_file import save_yarns
from weft.fiber_model.yarns.yarns import YarnSet
from weft.files.errors import InputError
from weft.pipeline.inspection.describe import READERS, describe
from weft.pipeline.progress import reporter
from weft.pipeline.run import run_chain
from weft.pipeline.scattering_file import read_scattering, write_scattering
from weft.renderer.image import write_exr, write_preview
from weft.voxelize.grid import FiberGrid, FiberVolume
from weft.voxelize.nanovdb import write_volume as write_nvdb

PYP = "*pattern\n0.01 0.01 0.001 4\n*Q\n" + "".join(f"{0.0025 * i} 0 0 0\n" for i in range(4))
PYP += "*E\n0 1 0 0\n1 2 0 0\n2 3 0 0\n3 0 1 0\n"
PARAMETERS = FiberScatteringParameters(0.1, 0.2, 1 / 3, 0.4, (0.1, 0.2, 0.3), 0.9)


def yarns():
    line = np.stack([np.linspace(0, 10, 5), np.zeros(5), np.zeros(5)], axis=1)
    return YarnSet.checked([line, line + 1.0], closed=[False, False], radius=0.5, type_names=("yarn",))


def volume():
    density = np.zeros((1, 512), np.float32)
    direction = np.zeros((1, 512, 3), np.float32)
    density[0, :7], direction[0, :7, 0] = 0.25, 1.0
    return FiberVolume({"yarn": FiberGrid(0.1, 0.01, np.zeros((1, 3), np.int32), density, direction)})


def facts(path, **options):
    (line,) = describe(path, as_json=True, **options)
    return json.loads(line)


@pytest.fixture
def files(tmp_path):
    """One file of each kind that can be made here."""
    save_yarns(yarns(), tmp_path / "yarns.npz")
    write_nvdb(tmp_path / "volume.nvdb", volume())
    pixels = np.arange(12, dtype=np.float32).reshape(3, 4)
    write_exr(tmp_path / "image.exr", {"R": pixels, "G": pixels, "B": pixels}, {"weft.seed": "7"})
    write_preview(tmp_path / "image.png", np.zeros((3, 4, 3)))
    write_scattering(tmp_path / "scattering.json", {"*": PARAMETERS})
    (tmp_path / "tile.pyp").write_text(PYP)
    (tmp_path / "lines.obj").write_text("v 0 0 0\nv 1 2 3\nl 1 2\n")
    (tmp_path / "job.toml").write_text('[yarns]\nkind = "knit"\nsize_mm = [9, 9]\nstitch_width_mm = 3.0\n')
    return tmp_path


def test_what_is_said_of_each_kind(files):
    assert facts(files / "yarns.npz")["yarns"] == 2
    assert facts(files / "yarns.npz")["length [mm]"] == pytest.approx(20)
    assert facts(files / "volume.nvdb")["media"]["yarn"]["voxels"] == 7
    assert facts(files / "image.exr")["channels"]["R"] == [0, 11]
    assert facts(files / "image.exr")["size"] == facts(files / "image.png")["size"] == "4 x 3"
    assert facts(files / "scattering.json")["*"]["fresnel_tt"] == 0.9
    assert facts(files / "tile.pyp")["yarn length in a tile [mm]"] == pytest.approx(10)
    assert facts(files / "lines.obj")["to"] == [1, 2, 3]
    assert facts(files / "job.toml")["yarns"]["stitch_width_mm"] == 3


def test_lines_for_people(files):
    lines = describe(files / "lines.obj")
    assert lines[2:6] == ["content    OBJ", "vertices   2", "polylines  1", "faces      0"]


KINDS = ["yarns.npz", "volume.nvdb", "image.exr", "image.png", "scattering.json", "tile.pyp"]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("keep", [0.0, 0.3, 0.9])
def test_truncated_files_are_refused(files, kind, keep):
    data = (files / kind).read_bytes()
    (files / kind).write_bytes(data[: int(len(data) * keep)])
    with pytest.raises(InputError) as caught:
        describe(files / kind)
    assert len(str(caught.value).splitlines()) == 1
    assert kind in str(caught.value)


@pytest.mark.parametrize("suffix", [suffix for suffix in READERS if suffix != ".obj"])
def test_noise_is_refused(tmp_path, suffix):
    path = tmp_path / f"noise{suffix}"
    path.write_bytes(np.random.default_rng(0).integers(0, 256, 4096, dtype=np.uint8).tobytes())
    with pytest.raises(InputError) as caught:
        describe(path)
    assert "noise" in str(caught.value)


def test_unknown_kinds_and_missing_files_are_refused(tmp_path):
    (tmp_path / "a.vdbb").touch()
    with pytest.raises(InputError, match=r"cannot look into '\.vdbb' files; did you mean '\.vdb'\?"):
        describe(tmp_path / "a.vdbb")
    with pytest.raises(InputError, match="no such file"):
        describe(tmp_path / "none.npz")
    with pytest.raises(InputError, match="is a folder"):
        describe(tmp_path)


def test_vertices_that_are_no_numbers_are_refused(tmp_path):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 nan 2\n")
    with pytest.raises(InputError, match=r"a\.obj:2: 'v 1 nan 2' is not a vertex"):
        describe(tmp_path / "a.obj")


def test_verify_compares_with_the_record_beside_it(folder, chain):
    run_chain(folder.load(), chain, ["cloth"], report=reporter("plain"))
    record = facts(folder.output / "cloth.run.json")
    assert record["outputs"] == {"cloth.txt": "unchanged"}
    (folder.output / "cloth.txt").write_text("other")
    assert facts(folder.output / "cloth.run.json")["outputs"] == {"cloth.txt": "was changed since"}


def test_verify_notices_one_changed_byte(folder, chain, monkeypatch):
    monkeypatch.setitem(READERS, ".txt", lambda path: {"content": "text"})
    run_chain(folder.load(), chain, ["cloth"], report=reporter("plain"))
    path = folder.output / "cloth.txt"
    assert facts(path, verify=True)["verified"] == "content is as cloth.run.json says"
    path.write_bytes(path.read_bytes()[:-1] + b"X")
    with pytest.raises(InputError, match=r"cloth\.txt: differs from what cloth\.run\.json says"):
        describe(path, verify=True)
    (folder.path / "alone.txt").touch()
    with pytest.raises(InputError, match="no run record beside it"):
        describe(folder.path / "alone.txt", verify=True)


def test_scattering_parameters_read_back_exactly(tmp_path):
    write_scattering(tmp_path / "s.json", {"*": PARAMETERS, "warp": PARAMETERS})
    assert read_scattering(tmp_path / "s.json") == {"*": PARAMETERS, "warp": PARAMETERS}


@pytest.mark.parametrize(
    "change",
    [
        lambda d: d.update(format="other"),
        lambda d: d.update(format_version=2),
        lambda d: d.update(media={}),
        lambda d: d["media"]["*"].pop("fresnel_r"),
        lambda d: d["media"]["*"].update(fresnel_tt="much"),
        lambda d: d["media"]["*"].update(fresnel_tt=2.0),
        lambda d: d["media"]["*"].update(fresnel_r=[1.0, 1.0]),
        lambda d: d["media"]["*"].update(longitudinal="cone"),
        lambda d: d["media"]["*"].update(longitudinal_width_r=True),
        lambda d: d["media"].update(warp=3),
    ],
)
def test_wrong_scattering_files_are_refused(tmp_path, change):
    path = tmp_path / "s.json"
    write_scattering(path, {"*": PARAMETERS})
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match=r"s\.json"):
        read_scattering(path)


def test_a_volume_of_another_program_is_described(tmp_path):
    """Its grids, and what a job must say to render it; it carries nothing to verify against."""
    from weft.voxelize.openvdb_library import extension, library_version

    if library_version() is None:
        pytest.skip("weft was installed without OpenVDB")
    path, origins = tmp_path / "a.vdb", np.zeros((1, 3), np.int32)
    masks, values = np.full((1, 8), 2**64 - 1, np.uint64), np.ones((1, 512, 3), np.float32)
    place = {"voxel_size": 0.2, "translation": [0.0] * 3}
    grids = [
        extension().LeafGrid("density", origins, masks, values[..., 0].copy(), **place),
        extension().LeafGrid("tangentu", origins, masks, values, **place),
    ]
    extension().write_grids(str(path), grids)
    text = "\n".join(describe(path))
    assert "volume of another program" in text
    assert "tangentu" in text
    assert "[render.foreign]" in text
    with pytest.raises(InputError, match="no hash"):
        describe(path, verify=True)
