"""A sequence is one run of the job for each frame; only what changed is made again, and nothing flickers."""

from __future__ import annotations

import os
import re
import tomllib

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.fiber_model.conftest import PRESETS
from weft.fiber_model.config import FibersConfig
from weft.fiber_model.fiber_curves import export_curves
from weft.fiber_model.fibers import run as run_fibers
from weft.fiber_model.yarns.formats.bcc import write_bcc
from weft.fiber_model.yarns.steady_frames import follow_rest
from weft.fiber_model.yarns.yarn_file import load_yarns
from weft.fiber_model.yarns.yarns import YarnSet
from weft.files.errors import InputError
from weft.pipeline.cli import exit_code
from weft.pipeline.config import load
from weft.pipeline.frames import frame_numbers
from weft.renderer.image import read_rgb

from .test_cli import job

SEQUENCE = """\
[yarns]
kind = "file"
file = "simulated/cloth.####.bcc"
scale_to_mm = 1.0
radius_mm = 0.8
[fibers]
preset = "cotton2"
fiber_count_scale = 0.3
[voxelize]
voxel_size_mm = 0.2
[scattering]
preset = "reference"
[render]
resolution = [12, 8]
samples_per_pixel = 4
block_samples = 2
"""
COUNT = 24


def arc(bend, count=COUNT, length=10.0, z=0.0):
    """A yarn of that length, straight or bent into a part of a circle; points [count, 3]."""
    s = np.linspace(0, length, count)
    if bend == 0:
        return np.stack([s, 0 * s, z + 0 * s], axis=1)
    return np.stack([np.sin(s * bend) / bend, (1 - np.cos(s * bend)) / bend, z + 0 * s], axis=1)


def write_frame(folder, frame, bend):
    folder.mkdir(exist_ok=True)
    yarns = YarnSet.checked([arc(bend), arc(bend, z=2.0)], radius=0.8)
    write_bcc(yarns, folder / f"cloth.{frame:04d}.bcc")


@pytest.fixture
def sequence(tmp_path):
    """Three frames of two yarns that bend."""
    for frame in (1, 2, 3):
        write_frame(tmp_path / "simulated", frame, 0.05 * frame)
    return job(tmp_path, SEQUENCE)


@pytest.mark.gl
def test_every_frame_has_its_results_and_only_what_changed_is_made_again(sequence, capsys):
    out = sequence.parent / "job.out"
    assert exit_code(["run", str(sequence), "--frames", "1:3"]) == 0
    pictures = [read_rgb(out / f"image.000{frame}.exr") for frame in (1, 2, 3)]
    assert not np.array_equal(pictures[0], pictures[1])
    for frame in (1, 2, 3):
        folder = out / f"frame_000{frame}"
        np.testing.assert_array_equal(read_rgb(folder / "image.exr"), pictures[frame - 1])
        expected = np.concatenate([arc(0.05 * frame), arc(0.05 * frame, z=2.0)])
        np.testing.assert_allclose(load_yarns(folder / "yarns.npz").points, expected, atol=1e-6)
    capsys.readouterr()
    write_frame(sequence.parent / "simulated", 2, 0.2)
    assert exit_code(["run", str(sequence), "--frames", "1:3"]) == 0
    frames = re.split(r"^frame \d+$", capsys.readouterr().err, flags=re.MULTILINE)[1:]
    assert ["stale" in text for text in frames] == [False, True, False]
    assert not np.array_equal(read_rgb(out / "image.0002.exr"), pictures[1])
    assert exit_code(["render", str(sequence), "--frame", "3"]) == 0


def test_yarns_that_move_without_rest_are_warned_of_once(sequence, capsys):
    def notes(*options):
        assert exit_code(["run", str(sequence), "--frames", "1:3", *options]) == 0
        return [line for line in capsys.readouterr().err.splitlines() if "yarns.rest is missing" in line]

    sequence.write_text(SEQUENCE.partition("[fibers]")[0])
    (note,) = notes()
    assert note.endswith("name the same yarns at rest, as rest = 'cloth.0001.bcc'")
    one_frame = sequence.parent / "simulated" / "cloth.0001.bcc"
    assert not notes("--set", f"yarns.rest={one_frame}")
    assert not notes("--set", f"yarns.file={one_frame}")


def test_both_ends_of_a_range_are_frames():
    assert frame_numbers("1:3") == [1, 2, 3]
    assert frame_numbers("7") == [7]
    assert frame_numbers("0:10:5") == [0, 5, 10]
    for wrong in ("3:1", "1-3", "", "a", "1:3:0", "-1:3", "0:9999999"):
        with pytest.raises(InputError, match="as in 1:10"):
            frame_numbers(wrong)


def test_a_frame_that_is_not_there_is_one_line_about_its_file(sequence, capsys):
    assert exit_code(["run", str(sequence), "--frames", "9"]) == 2
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line != "frame 9"]
    assert "cloth.0009.bcc; did you mean 'cloth.000" in line
    assert exit_code(["check", str(sequence), "--frame", "9"]) == 2
    assert exit_code(["check", str(sequence), "--frame", "3"]) == 0


def test_numbers_stand_in_names_of_both_kinds(tmp_path):
    write_frame(tmp_path / "simulated", 12, 0.1)
    os.rename(tmp_path / "simulated" / "cloth.0012.bcc", tmp_path / "simulated" / "c12.bcc")
    path = job(tmp_path, SEQUENCE.replace("cloth.####.bcc", "c%d.bcc"))
    loaded = load(path, frame=12)
    assert loaded.config.yarns.file.name == "c12.bcc"
    assert loaded.output.name == "frame_0012"


def fibers_of(points, rest):
    values = tomllib.loads((PRESETS / "cotton2.toml").read_text(encoding="utf-8"))
    config = FibersConfig.model_validate({**values, "preset": "cotton2", "fiber_count_scale": 0.3})
    one, other = (YarnSet.checked([curve], radius=0.8) for curve in (points, rest))
    return export_curves(run_fibers(config, follow_rest(one, other)))


@pytest.mark.parametrize("seed", range(6))
def test_fibers_move_with_their_yarn(seed):
    """Turned in any way and moved, each point of each fiber is where the motion takes it."""
    rest = arc(0.05)
    rotation = Rotation.random(random_state=seed).as_matrix()
    still, moved = fibers_of(rest, rest), fibers_of(rest @ rotation.T + [30.0, -20.0, 5.0], rest)
    np.testing.assert_array_equal(moved.offsets, still.offsets)
    np.testing.assert_array_equal(moved.kind, still.kind)
    np.testing.assert_allclose(moved.points, still.points @ rotation.T + [30.0, -20.0, 5.0], atol=2e-4)


def test_fibers_do_not_flicker_while_a_yarn_bends():
    """The same fibers and fly-aways; no point jumps, whatever axis the first tangent is nearest to."""
    rest, before = arc(0.0), None
    for frame in range(40):
        turn = Rotation.from_euler("y", 2.5 * frame, degrees=True).as_matrix()
        fibers = fibers_of(arc(0.005 * frame) @ turn.T, rest)
        if before is not None:
            np.testing.assert_array_equal(fibers.offsets, before.offsets)
            np.testing.assert_array_equal(fibers.kind, before.kind)
            # the yarn's end moves by 0.7 mm a frame
            assert np.linalg.norm(fibers.points - before.points, axis=1).max() < 0.8
        before = fibers


def test_rest_must_be_of_the_same_yarns(sequence):
    rest = sequence.parent / "simulated" / "other.bcc"
    write_bcc(YarnSet.checked([arc(0.0)], radius=0.8), rest)
    sequence.write_text(SEQUENCE.replace("[fibers]", f'rest = "{rest}"\n[fibers]'))
    assert exit_code(["yarns", str(sequence), "--frame", "1"]) == 2


SQUARE = """\
v 0 0 {0}
v 20 0 0
v 20 20 {0}
v 0 20 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
f 1/1 2/2 3/3
f 1/1 3/3 4/4
"""
GARMENT = """\
[yarns]
kind = "garment"
[yarns.surface]
kind = "mesh"
file = "cloth.##.obj"
scale_to_mm = 1.0
uv_unit_mm = 20.0
[yarns.pattern]
kind = "knit"
stitch_width_mm = 5.0
"""


def test_a_garment_keeps_its_stitches_while_its_mesh_moves(tmp_path, capsys):
    for frame in (1, 2, 3):
        (tmp_path / f"cloth.{frame:02d}.obj").write_text(SQUARE.format(frame - 1.0))
    path = job(tmp_path, GARMENT)
    assert exit_code(["run", str(path), "--frames", "1:3"]) == 0
    frames = [load_yarns(tmp_path / "job.out" / f"frame_000{frame}" / "yarns.npz") for frame in (1, 2, 3)]
    for frame in frames[1:]:
        np.testing.assert_array_equal(frame.offsets, frames[0].offsets)
        np.testing.assert_allclose(frame.surface_uv, frames[0].surface_uv, atol=1e-9)
    assert np.abs(frames[2].points - frames[0].points).max() == pytest.approx(2.0, abs=0.6)
    rest = GARMENT.replace("uv_unit_mm", 'rest = "cloth.01.obj"\nuv_unit_mm')
    path.write_text(rest)
    assert exit_code(["run", str(path), "--frames", "1:3:2"]) == 0
    twists = [load_yarns(tmp_path / "job.out" / f"frame_000{frame}" / "yarns.npz").twist for frame in (1, 3)]
    np.testing.assert_allclose(twists[0], 0, atol=1e-9)
    assert np.abs(twists[1]).max() > 1e-3
    path.write_text(GARMENT.replace("uv_unit_mm = 20.0\n", ""))
    capsys.readouterr()
    assert exit_code(["run", str(path), "--frames", "1:3"]) == 2
    assert "Take the (u, v) of the file, with uv_unit_mm" in capsys.readouterr().err


MOVING = """#usda 1.0
( metersPerUnit = 0.001
  upAxis = "Y" )
def Mesh "cloth" {
  int[] faceVertexCounts = [4]
  int[] faceVertexIndices = [0, 1, 2, 3]
  point3f[] points.timeSamples = { 1: [(0,0,0), (20,0,0), (20,20,0), (0,20,0)],
                                   3: [(0,0,4), (20,0,4), (20,20,4), (0,20,4)] }
  texCoord2f[] primvars:st = [(0,0), (1,0), (1,1), (0,1)] ( interpolation = "faceVarying" )
}
"""


def test_a_usd_mesh_that_moves_is_read_at_the_frame(tmp_path):
    pytest.importorskip("pxr", reason="usd-core is not installed; pip install usd-core")
    (tmp_path / "cloth.usda").write_text(MOVING)
    path = job(tmp_path, GARMENT.replace("cloth.##.obj", "cloth.usda").replace("scale_to_mm = 1.0\n", ""))
    assert exit_code(["run", str(path), "--frames", "1:3"]) == 0
    heights = [
        load_yarns(tmp_path / "job.out" / f"frame_000{frame}" / "yarns.npz").points[:, 2]
        for frame in (1, 2, 3)
    ]
    np.testing.assert_allclose(heights[1] - heights[0], 2.0, atol=1e-4)
    np.testing.assert_allclose(heights[2] - heights[0], 4.0, atol=1e-4)
