"""Previews as pictures: drawn off screen by the real command in a process of its own, then looked at.

In this process the renderer's tests hold an OpenGL context, which vtk's would disturb.
"""

from __future__ import annotations

import json
import os
import struct
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from weft.fiber_model.fiber_curves import FiberCurves, write_curves
from weft.fiber_model.yarns.yarn_file import save_yarns
from weft.fiber_model.yarns.yarns import YarnSet
from weft.pipeline.cli import exit_code
from weft.pipeline.preview.overlay import INK
from weft.pipeline.preview.scene import DIRECTION_COLORS, HAIR_COLOR, LOOP_COLOR, PALETTE
from weft.renderer.image import srgb, write_exr
from weft.voxelize.grid import FiberGrid, FiberVolume
from weft.voxelize.nanovdb import write_volume

SIZE = (640, 480)
PYP = "*pattern\n0.01 0.01 0.001 4\n*Q\n" + "".join(f"{0.0025 * i} 0 0 0\n" for i in range(4))
PYP += "*E\n0 1 0 0\n1 2 0 0\n2 3 0 0\n3 0 1 0\n"
POLY = "POINTS\n" + "".join(f"{i}: {i} 0 0\n" for i in range(1, 6))
POLY += "POLYS\n" + "".join(f"{i}: {i} {i + 1}\n" for i in range(1, 5)) + "END\n"
USDA = """#usda 1.0
def Mesh "cloth" {
  int[] faceVertexCounts = [3]
  int[] faceVertexIndices = [0, 1, 2]
  point3f[] points = [(0,0,0), (1,0,0), (0,1,0)]
}
"""
MESH = "v 0 0 0\nv 10 0 0\nv 0 10 0\nf 1 2 3\n"
JOB = '[yarns]\nkind = "knit"\nsize_mm = [12, 10]\nstitch_width_mm = 6.0\n[fibers]\npreset = "cotton1"\n'
RUN = """
import json, sys
from weft.pipeline.cli import exit_code
for arguments in json.loads(sys.argv[1]):
    assert exit_code(["preview", *arguments]) == 0, arguments
"""


def straight(y, length=10.0):
    return np.stack([np.linspace(0, length, 8), np.full(8, y), np.zeros(8)], axis=1)


def circle():
    angle = np.arange(12) / 12 * 2 * np.pi
    return np.stack([4 * np.cos(angle), 4 * np.sin(angle), 0 * angle], axis=1)


def fibers():
    """Three plies of ten straight fibers, one with a loop, and a hair."""
    x = np.linspace(0, 2, 40, dtype=np.float32)
    y = 0.05 * np.arange(31, dtype=np.float32)
    points = np.stack([np.tile(x, 31), np.repeat(y, 40), np.zeros(31 * 40, np.float32)], axis=1)
    kind = np.zeros(31 * 40, np.uint8)
    kind[10:30], kind[-40:] = 1, 2
    ply = np.append(np.repeat(np.arange(3), 10), -1).astype(np.int32)
    return FiberCurves(
        points,
        kind,
        np.arange(32, dtype=np.int64) * 40,
        ply,
        np.zeros(31, np.int32),
        np.full(31, 0.02, np.float32),
    )


def volume():
    """A block of 16 x 16 x 8 voxels with density along x from 0.1 to 0.8, directions along y."""
    origins = np.array([[0, 0, 0], [0, 8, 0], [8, 0, 0], [8, 8, 0]], np.int32)
    along = np.repeat(np.linspace(0.1, 0.8, 8, dtype=np.float32), 64)
    density = np.tile(along, (4, 1))
    direction = np.zeros((4, 512, 3), np.float32)
    direction[..., 1] = 1
    return FiberVolume({"yarn": FiberGrid(0.25, 0.01, origins, density, direction)})


def write_bcc(path):
    points = straight(0.0).astype("<f4")
    path.write_bytes(
        struct.pack("<3sB2sBBQQ40s", b"BCC", 0x44, b"C0", 3, 1, 1, 8, b"")
        + struct.pack("<i", 8)
        + points.tobytes()
    )


def write_inputs(folder):
    types = {"yarn_type": [0, 1], "type_names": ("warp", "weft")}
    save_yarns(YarnSet.checked([straight(0), straight(4)], radius=0.5, **types), folder / "yarns.npz")
    for name, closed in (("loop", True), ("arc", False)):
        save_yarns(YarnSet.checked([circle()], closed=closed, radius=0.4), folder / f"{name}.npz")
    write_bcc(folder / "a.bcc")
    (folder / "a.pyp").write_text(PYP)
    (folder / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 2 1 0\nv 3 0 0\nl 1 2 3 4\n")
    (folder / "mesh.obj").write_text(MESH)
    (folder / "a.poly").write_text(POLY)
    (folder / "bare.usda").write_text(USDA)
    (folder / "cloth.usda").write_text(USDA.replace("1.0\n", "1.0\n( metersPerUnit = 0.01 )\n"))
    (folder / "job.toml").write_text(JOB)
    write_curves(fibers(), folder / "fibers.npz")
    write_volume(folder / "grid.nvdb", volume())
    gray = np.full((24, 32), 0.1, np.float32)
    write_exr(folder / "gray.exr", dict.fromkeys("RGB", gray), {})


PICTURES = {
    "yarns": ["yarns.npz"],
    "loop": ["loop.npz"],
    "arc": ["arc.npz"],
    "bcc": ["a.bcc", "--scale-to-mm", "1", "--radius-mm", "0.5"],
    "pyp": ["a.pyp"],
    "obj": ["a.obj", "--scale-to-mm", "10", "--radius-mm", "1"],
    "mesh": ["mesh.obj", "--scale-to-mm", "10"],
    "poly": ["a.poly", "--scale-to-mm", "10", "--radius-mm", "1"],
    "garment": ["cloth.usda"],
    "fibers": ["fibers.npz"],
    "grid": ["grid.nvdb"],
    "surface": ["grid.nvdb", "--surface", "0.4", "--view", "iso"],
    "slices": ["grid.nvdb", "--slice", "x=0.125", "--slice", "z=1.0", "--view", "iso"],
    "picture": ["gray.exr", "--exposure", "1"],
    "job": ["job.toml"],
    "job_fibers": ["job.toml", "--part", "fibers", "--set", "fibers.fuzz=3", "--box=-0.8,-0.8,-2,0.8,0.8,2"],
    "panels": ["yarns.npz", "fibers.npz"],
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """All inputs, and the pictures that one process made of them; the last one without --out."""
    folder = tmp_path_factory.mktemp("preview")
    write_inputs(folder)
    calls = [
        [*arguments, "--out", f"{name}.png", "--size", "640x480"] for name, arguments in PICTURES.items()
    ]
    without_display = {key: value for key, value in os.environ.items() if "DISPLAY" not in key}
    done = subprocess.run(
        [sys.executable, "-c", RUN, json.dumps([*calls, ["loop.npz", "--size", "320x240"]])],
        capture_output=True,
        text=True,
        cwd=folder,
        env=without_display,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    (folder / "said.txt").write_text(done.stdout)
    assert done.stderr == ""
    return folder


@pytest.fixture
def levels(folder):
    def read(name):
        return np.asarray(Image.open(folder / f"{name}.png").convert("RGB")).astype(int)

    return read


def hue_share(levels, color):
    """Part of the picture that has the hue of a color, at any shade, and is about as saturated."""
    color = np.array(color, float)
    light = levels.max(axis=2)
    near = np.abs(levels / np.maximum(light, 1)[..., None] - color / color.max()).max(axis=2) < 0.12
    return (near & (light > 30)).mean()


def body(levels):
    """Colored pixels, apart from text, bar and axes in the corners."""
    colored = np.ptp(levels, axis=2) > 30
    colored[:60] = False
    colored[380:, :160] = False
    return colored


def bar_pixels(levels):
    """Length of the longest row of ink near the lower right corner."""
    return (levels[450:, 320:] < (255 + INK[0]) / 2).all(axis=2).sum(axis=1).max()


@pytest.mark.parametrize("name", sorted(set(PICTURES) - {"panels"}))
def test_no_picture_is_blank_and_none_is_filled(levels, name):
    picture = levels(name)
    assert picture.shape == (480, 640, 3)
    foreground = (picture != picture[-1, -1]).any(axis=2)[60:400].mean()
    assert 0.02 < foreground < 0.95


def test_yarns_have_the_colors_of_their_types(levels):
    assert hue_share(levels("yarns"), PALETTE[0]) > 0.02
    assert hue_share(levels("yarns"), PALETTE[1]) > 0.02
    assert hue_share(levels("loop"), PALETTE[1]) < 1e-3


def test_yarns_have_the_right_length_and_radius_by_the_scale_bar(levels):
    picture = levels("yarns")
    yarn = body(picture) & (
        picture[..., 0] < np.minimum(picture[..., 2], 128)
    )  # the blue one, 10 mm long and 1 mm thick
    columns, rows = np.flatnonzero(yarn.any(axis=0)), np.flatnonzero(yarn.any(axis=1))
    pixels_per_mm = (np.ptp(columns) + 1) / 10.0
    bar_mm = bar_pixels(picture) / pixels_per_mm
    assert bar_mm == pytest.approx(2.0, rel=0.015)
    assert np.ptp(rows) + 1 == pytest.approx(1.0 * pixels_per_mm, abs=2.0)


def test_the_scale_bar_is_drawn_over_the_same_mm_in_fibers(levels):
    picture = levels("fibers")
    columns = np.flatnonzero((body(picture) & (picture[..., 2] < 128)).any(axis=0))
    pixels_per_mm = (np.ptp(columns) + 1) / 2.0  # fibers of 2 mm
    assert bar_pixels(picture) / pixels_per_mm == pytest.approx(0.5, rel=0.015)


def test_closed_loops_are_closed(levels):
    from scipy import ndimage

    for name, areas in (("loop", 2), ("arc", 1)):
        background = ~body(levels(name))
        labels, _ = ndimage.label(background)
        large = np.bincount(labels.ravel())[1:] > 2000
        assert large.sum() == areas


def test_plies_and_fly_aways_are_told_apart(levels):
    picture = levels("fibers")
    for color in PALETTE[:3]:
        assert hue_share(picture[100:], color) > 0.004
    assert hue_share(picture[100:], PALETTE[3]) < 1e-3
    assert hue_share(picture[100:], LOOP_COLOR) > 4e-4
    shown = picture[42:380]
    hair = (np.ptp(shown, axis=2) < 25) & (shown.max(axis=2) < 90)
    assert hair.mean() > 4e-4
    assert max(HAIR_COLOR) < 60
    job = levels("job_fibers")
    assert all(hue_share(job[100:], color) > 0.002 for color in PALETTE[:2])


def test_a_slice_goes_from_light_to_dark_with_directions_and_a_color_bar(levels):
    picture = levels("grid")
    assert hue_share(picture[100:400], DIRECTION_COLORS[0]) > 1e-3
    bar = picture[100:400, 540:]
    assert len(np.unique(bar[np.ptp(bar, axis=2) > 40].reshape(-1, 3), axis=0)) > 30
    shown = picture[200:330, :500]
    brown = np.ptp(shown, axis=2) > 30
    columns = np.flatnonzero(brown.any(axis=0))
    light = shown.sum(axis=2) * brown
    sixteenth = len(columns) // 16  # one voxel; densities rise over eight and begin again
    first, last = columns[2 : sixteenth - 2], columns[7 * sixteenth + 2 : 8 * sixteenth - 2]
    assert light[:, first].max() > 1.5 * light[:, last].max()


def test_pictures_are_brightened_by_the_exposure(levels):
    picture = levels("picture")
    expected = round(float(srgb(np.array(0.2))) * 255)
    assert np.abs(picture[240, 320] - expected).max() <= 1


def test_panels_stand_side_by_side(levels):
    picture = levels("panels")
    assert hue_share(picture[:, :320], PALETTE[1]) > 0.005
    assert hue_share(picture[:, 320:], PALETTE[2]) > 0.005
    assert hue_share(picture[:, :320], PALETTE[2]) < 1e-3


def test_without_a_display_it_writes_a_picture_and_says_so(folder):
    assert Image.open(folder / "loop.preview.png").size == (320, 240)
    said = (folder / "said.txt").read_text().splitlines()
    assert said[-1] == "no display here, so it wrote loop.preview.png"
    assert "yarns.npz: 2 yarns, 20 mm, 11 x 5 x 1 mm" in said
    assert any(line.startswith("  part: x -1..1") or "[export]" in line or "--box" in line for line in said)


def test_the_part_with_most_fibers_is_whole_where_it_fits(folder):
    said = (folder / "said.txt").read_text()
    assert "part only" not in said


BAD = {
    "no.npz": ([], "no.npz: no such file"),
    "a.bcc": ([], "a.bcc: .bcc files name no unit; give --scale-to-mm"),
    "a.obj": (["--scale-to-mm", "1"], "a.obj: .obj files hold no yarn radius; give --radius-mm"),
    "cut.bcc": (["--scale-to-mm", "1", "--radius-mm", "1"], "truncated"),
    "cut.npz": ([], "cut.npz: is not a readable .npz file"),
    "cut.nvdb": ([], "cut.nvdb"),
    "cut.exr": ([], "cut.exr"),
    "x.docx": ([], "x.docx: weft cannot show '.docx' files"),
    "yarns.npz": (["--part", "fibers"], "--part is for jobs"),
    "loop.npz": (["--slice", "q=1"], "--slice: 'q=1' is no plane"),
    "arc.npz": (["--box", "1,2,3"], "--box: '1,2,3' is no box"),
    "fibers.npz": (["--box", "50,50,50,51,51,51"], "--box: no fibers lies in it"),
    "grid.nvdb": (["--slice", "z=77"], "--slice: z=77 misses the grid"),
    "gray.exr": (["--size", "12"], "--size: '12' is no size"),
    "job.toml": (["--part", "grid"], "needs the table [voxelize]"),
    "a.poly": (["--radius-mm", "1"], ".poly files name no unit; give --scale-to-mm"),
    "bare.usda": ([], "does not name its unit (metersPerUnit). Give --scale-to-mm"),
    "a.pyp": (["--scale-to-mm=-1"], "--scale-to-mm: -1 is no length"),
    "bad.toml": ([], "bad.toml:1: yarns.kind"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_line_and_exit_code_2_and_no_picture(tmp_path, capfd, name):
    write_inputs(tmp_path)
    (tmp_path / "x.docx").write_text("x")
    (tmp_path / "bad.toml").write_text('[yarns]\nknid = "knit"\n')
    for cut, whole in (
        ("cut.bcc", "a.bcc"),
        ("cut.npz", "yarns.npz"),
        ("cut.nvdb", "grid.nvdb"),
        ("cut.exr", "gray.exr"),
    ):
        (tmp_path / cut).write_bytes((tmp_path / whole).read_bytes()[:-40])
    arguments, expected = BAD[name]
    capfd.readouterr()
    assert exit_code(["preview", str(tmp_path / name), "--out", str(tmp_path / "p.png"), *arguments]) == 2
    lines = capfd.readouterr().err.splitlines()
    assert expected in "\n".join(lines)
    assert len(lines) == 1
    assert not list(tmp_path.glob("*.png"))


def test_pictures_are_png(tmp_path, capsys):
    write_inputs(tmp_path)
    assert exit_code(["preview", str(tmp_path / "loop.npz"), "--out", str(tmp_path / "p.jpg")]) == 2
    assert "--out writes .png pictures" in capsys.readouterr().err


def test_a_grid_that_was_not_made_yet_names_the_command(tmp_path, capsys):
    (tmp_path / "job.toml").write_text(JOB + "[voxelize]\nvoxel_size_mm = 0.3\n")
    assert exit_code(["preview", str(tmp_path / "job.toml"), "--part", "grid"]) == 2
    assert "volume.vdb does not exist yet. Run 'weft run" in capsys.readouterr().err
