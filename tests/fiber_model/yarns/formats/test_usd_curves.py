"""USD BasisCurves: every basis and wrap, units, axes, transforms, frames; what is written comes back."""

import signal
import subprocess
import sys
from itertools import pairwise

import numpy as np
import pytest

from tests.fiber_model.yarns.formats.forks import MOST_SECONDS, in_forks
from tests.fiber_model.yarns.formats.mutants import read_mutants
from tests.fiber_model.yarns.formats.test_follow import (
    RADIUS,
    dense,
    distance_to_polyline,
    smooth_bezier,
    smooth_walk,
)
from weft.fiber_model.yarns.catmull_rom import CatmullRom
from weft.fiber_model.yarns.formats import usd_curves, usd_stage
from weft.fiber_model.yarns.formats.follow import TOLERANCE
from weft.fiber_model.yarns.formats.usd_curves import read_usd
from weft.fiber_model.yarns.formats.usd_export import write_usd
from weft.fiber_model.yarns.yarns import YarnSet
from weft.files.errors import InputError

pytest.importorskip("pxr", reason="usd-core is not installed; pip install usd-core")
WALK = smooth_walk(10, 3).astype(np.float32).astype(np.float64)
ANGLE = np.arange(12) * 2 * np.pi / 12
LOOP = np.stack([3 * np.cos(ANGLE), 2 * np.sin(ANGLE), 0.3 * np.sin(2 * ANGLE)], axis=1)
STAGE = '#usda 1.0\n({stage})\n{above}def BasisCurves "c" {{\n{body}\n}}\n{below}'
MM = 'metersPerUnit = 0.001\nupAxis = "Y"\n'


def vectors(points):
    return "[" + ", ".join(f"({x!r}, {y!r}, {z!r})" for x, y, z in np.asarray(points).tolist()) + "]"


def usda(
    points,
    *,
    counts=None,
    kind="cubic",
    basis="catmullRom",
    wrap="pinned",
    more="",
    stage=MM,
    above="",
    below="",
):
    body = f"""int[] curveVertexCounts = {[len(points)] if counts is None else counts}
uniform token type = "{kind}"
uniform token basis = "{basis}"
uniform token wrap = "{wrap}"
{more}"""
    if points is not None:
        body += f"\npoint3f[] points = {vectors(points)}"
    return STAGE.format(stage=stage, body=body, above=above, below=below)


WIDTH = f'float[] widths = [{2 * RADIUS}] (\ninterpolation = "constant"\n)'


def read(tmp_path, text, **options):
    (tmp_path / "c.usda").write_text(text)
    return read_usd(tmp_path / "c.usda", **options)


def yarn_curve(yarns, count=16):
    return dense(CatmullRom.through(yarns).coefficients, count)


def de_boor(points, closed):
    """Uniform cubic B-spline as the mean of means: each point is the weighted mean of four (Cox, de Boor)."""
    n = len(points)
    u = np.linspace(0, 1, 40, endpoint=False)[:, None]
    parts = []
    for k in range(n if closed else n - 3):
        a, b, c, d = points[np.arange(k, k + 4) % n]
        p, q, r = a + (b - a) * (u + 2) / 3, b + (c - b) * (u + 1) / 3, c + (d - c) * u / 3
        p, q = p + (q - p) * (u + 1) / 2, q + (r - q) * u / 2
        parts.append(p + (q - p) * u)
    end = parts[0][:1] if closed else (points[None, -3] + 4 * points[None, -2] + points[None, -1]) / 6
    return np.concatenate([*parts, end])


def casteljau(points):
    u = np.linspace(0, 1, 60)[:, None]
    parts = []
    for k in range(0, len(points) - 3, 3):
        level = [points[k + j] + 0 * u for j in range(4)]
        while len(level) > 1:
            level = [p + (q - p) * u for p, q in pairwise(level)]
        parts.append(level[0])
    return np.concatenate(parts)


def reflected(points):
    return np.concatenate([[2 * points[0] - points[1]], points, [2 * points[-1] - points[-2]]])


@pytest.fixture
def fork(monkeypatch):
    """Read in forks, which takes 0.03 s in place of 0.7."""
    monkeypatch.setattr(usd_curves.subprocess, "run", in_forks(usd_stage.main))


@pytest.mark.usefixtures("fork")
@pytest.mark.parametrize(
    ("basis", "wrap", "points", "wanted"),
    [
        ("bspline", "nonperiodic", WALK, de_boor(WALK, False)),
        ("bspline", "pinned", WALK, de_boor(reflected(WALK), False)),
        ("bspline", "periodic", LOOP, de_boor(LOOP, True)),
        ("bezier", "nonperiodic", smooth_bezier(WALK), casteljau(smooth_bezier(WALK))),
        ("bezier", "pinned", smooth_bezier(WALK), casteljau(smooth_bezier(WALK))),
        ("bezier", "periodic", LOOP, casteljau(np.concatenate([LOOP, LOOP[:1]]))),
    ],
)
def test_other_bases_are_followed_to_the_tolerance(tmp_path, basis, wrap, points, wanted):
    if basis == "bezier" and wrap == "periodic":  # make the joints smooth: each the middle of its neighbors
        points = points.copy()
        points[::3] = 0.5 * (np.roll(points, 1, axis=0)[::3] + points[1::3])
        wanted = casteljau(np.concatenate([points, points[:1]]))
    yarns = read(tmp_path, usda(points, basis=basis, wrap=wrap, more=WIDTH))
    assert yarns.closed.tolist() == [wrap == "periodic"]
    assert yarns.radius == pytest.approx([RADIUS])
    made = yarn_curve(yarns)
    assert distance_to_polyline(made, wanted).max() < TOLERANCE * RADIUS
    assert distance_to_polyline(wanted, made).max() < TOLERANCE * RADIUS + 1e-3


@pytest.mark.parametrize(
    ("kind", "wrap"),
    [("cubic", "pinned"), ("cubic", "periodic"), ("linear", "nonperiodic"), ("linear", "periodic")],
)
@pytest.mark.usefixtures("fork")
def test_points_of_our_own_kinds_are_kept(tmp_path, kind, wrap):
    yarns = read(tmp_path, usda(WALK, kind=kind, wrap=wrap, more=WIDTH))
    assert np.array_equal(yarns.points, WALK)
    assert yarns.closed.tolist() == [wrap == "periodic"]


@pytest.mark.usefixtures("fork")
def test_catmull_rom_with_guides_begins_at_its_second_point(tmp_path):
    yarns = read(tmp_path, usda(WALK, wrap="nonperiodic", more=WIDTH))
    assert yarns.points[0] == pytest.approx(WALK[1], abs=1e-6)
    assert yarns.points[-1] == pytest.approx(WALK[-2], abs=1e-6)


@pytest.mark.usefixtures("fork")
def test_unit_axis_and_transforms(tmp_path):
    above = """def Xform "a" {
    double3 xformOp:translate = (10, 20, 30)
    float xformOp:rotateX = 90
    float3 xformOp:scale = (2, 2, 2)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateX", "xformOp:scale"]
"""
    text = usda(WALK, more=WIDTH, stage='metersPerUnit = 0.01\nupAxis = "Z"\n', above=above, below="}")
    yarns = read(tmp_path, text)
    turned = np.stack([WALK[:, 0], -WALK[:, 2], WALK[:, 1]], axis=1)
    x, y, z = 10.0 * (2.0 * turned + [10, 20, 30]).T
    assert yarns.points == pytest.approx(np.stack([x, z, -y], axis=1), rel=1e-6)
    assert yarns.radius == pytest.approx([20.0 * RADIUS])
    assert read(tmp_path, text, scale_to_mm=1.0).radius == pytest.approx([2.0 * RADIUS])


@pytest.mark.usefixtures("fork")
def test_a_file_without_unit_needs_one(tmp_path):
    text = usda(WALK, more=WIDTH, stage="")
    with pytest.raises(InputError, match=r"does not name its unit \(metersPerUnit\). Give 'scale_to_mm'"):
        read(tmp_path, text)
    yarns = read(tmp_path, text, scale_to_mm=2.0, up_axis=2)
    assert yarns.points[:, 1] == pytest.approx(2.0 * WALK[:, 2])


@pytest.mark.parametrize(
    ("interpolation", "widths", "radius"),
    [
        ("constant", [0.5], [0.25, 0.25]),
        ("uniform", [0.5, 1.0], [0.25, 0.5]),
        ("vertex", [0.5] * 4 + [1.0] * 6, [0.25, 0.5]),
        ("varying", [0.5] * 2 + [1.0] * 4, [0.25, 0.5]),
    ],
)
@pytest.mark.usefixtures("fork")
def test_widths_are_diameters(tmp_path, interpolation, widths, radius):
    more = f'float[] widths = {widths} (\ninterpolation = "{interpolation}"\n)'
    text = usda(WALK, counts=[4, 6], basis="bspline", wrap="nonperiodic", more=more)
    assert read(tmp_path, text).radius == pytest.approx(radius)
    assert read(tmp_path, text, radius_mm=0.7).radius.tolist() == [0.7, 0.7]


@pytest.mark.usefixtures("fork")
@pytest.mark.parametrize(
    ("basis", "counts", "widths"),
    [("bspline", [6, 6], [0.5] * 6 + [1.0] * 6), ("bezier", [6, 6], [0.5, 0.5, 1.0, 1.0])],
)
def test_loops_have_one_varying_width_for_each_segment(tmp_path, basis, counts, widths):
    more = f'float[] widths = {widths} (\ninterpolation = "varying"\n)'
    angle = np.arange(6) * 2 * np.pi / 6
    ring = np.stack([3 * np.cos(angle), 3 * np.sin(angle), 0 * angle], axis=1)
    ring[::3] *= 0.5  # the joints of a bezier curve lie on a line with their handles
    loops = np.concatenate([ring, ring + 9])
    text = usda(loops, counts=counts, basis=basis, wrap="periodic", more=more)
    assert read(tmp_path, text).radius == pytest.approx([0.25, 0.5])


SHIFT = np.array([2.0, 0.0, 0.0])
MOVING = f"point3f[] points.timeSamples = {{ 10: {vectors(WALK)}, 12: {vectors(WALK + SHIFT)}, }}\n" + WIDTH


@pytest.mark.usefixtures("fork")
def test_one_frame_of_moving_curves(tmp_path):
    text = usda(None, counts=[10], more=MOVING)
    assert np.array_equal(read(tmp_path, text, frame=10).points, WALK)
    assert read(tmp_path, text, frame=11).points == pytest.approx(WALK + 0.5 * SHIFT, abs=1e-6)
    assert read(tmp_path, text, frame=12).points == pytest.approx(WALK + SHIFT, abs=1e-6)
    with pytest.raises(InputError, match="no frame 13; the file has 10 to 12"):
        read(tmp_path, text, frame=13)
    with pytest.raises(InputError, match="the curves move from frame 10 to 12; choose one with 'frame'"):
        read(tmp_path, text)


@pytest.mark.usefixtures("fork")
def test_a_transform_may_move_too(tmp_path):
    above = """def Xform "a" {
    double3 xformOp:translate.timeSamples = { 1: (0, 0, 0), 5: (8, 0, 0) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
"""
    text = usda(WALK, more=WIDTH, above=above, below="}")
    assert read(tmp_path, text, frame=3).points == pytest.approx(WALK + 2 * SHIFT, abs=1e-6)
    with pytest.raises(InputError, match="the curves move from frame 1 to 5; choose one with 'frame'"):
        read(tmp_path, text)


@pytest.mark.usefixtures("fork")
def test_instances_are_read_and_hidden_prims_are_not(tmp_path):
    body = usda(WALK, more=WIDTH).split("\n)\n", 1)[1]
    text = f"""#usda 1.0
({MM})
class "Cloth" {{ {body} }}
def Xform "first" (instanceable = true
    inherits = </Cloth>) {{}}
def Xform "second" (instanceable = true
    inherits = </Cloth>) {{
    double3 xformOp:translate = (2, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}}
def Xform "hidden" (inherits = </Cloth>) {{
token visibility = "invisible"
}}
def Xform "guide" (inherits = </Cloth>) {{
uniform token purpose = "guide"
}}
"""
    yarns = read(tmp_path, text)
    assert yarns.yarn_count == 2
    assert yarns.yarn(0) == pytest.approx(WALK)
    assert yarns.yarn(1) == pytest.approx(WALK + SHIFT, abs=1e-6)


def a_set(*, loops=True):
    rng = np.random.default_rng(4)
    curves = [smooth_walk(n, n).astype(np.float32) for n in (6, 5, 9, 4)]
    return YarnSet.checked(
        curves,
        closed=[False, loops, False, loops],
        radius=[0.25, 0.5, 0.75, 0.25],
        yarn_type=[0, 1, 1, 0],
        type_names=("warp", "weft"),
        twist=[rng.normal(size=len(curve)) for curve in curves],
        surface_uv=[rng.random(size=(len(curve), 2)).astype(np.float32) for curve in curves],
    )


@pytest.mark.parametrize("suffix", ["usda", "usdc", "usd"])
def test_yarns_written_here_are_read_back(tmp_path, suffix):
    yarns = a_set()
    write_usd(yarns, tmp_path / f"y.{suffix}")
    again = read_usd(tmp_path / f"y.{suffix}")
    assert again.type_names == yarns.type_names
    for name in ("points", "offsets", "closed", "radius", "yarn_type", "twist", "surface_uv"):
        assert np.array_equal(getattr(again, name), getattr(yarns, name)), name


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("#usda 1.0\n", "no visible BasisCurves in this file"),
        ("BCC", "USD cannot read this file; is it damaged?"),
        ('#usda 1.0\ndef NurbsCurves "n" {}\n', "/n is of type NurbsCurves; convert it to BasisCurves"),
        (
            '#usda 1.0\ndef "a" (references = @other.usda@) {}\n',
            "refers to other files ('other.usda'); flatten it into one file first",
        ),
        (usda(WALK), "/c has no 'widths', so 'radius_mm' must be given"),
        (
            usda(WALK, more="float[] widths = [1, 2, 3]"),
            "/c has 3 widths; 'vertex' takes 10. Mend it or give 'radius_mm'",
        ),
        (
            usda(WALK, more=f"float[] widths = {[0.5] * 9 + [1.0]}"),
            "yarn 0 is 0.25 to 0.5 mm in radius along its length; a yarn has one radius, so give 'radius_mm'",
        ),
        (
            usda(WALK, counts=[9], more=WIDTH),
            "/c: 'curveVertexCounts' add up to 9, but there are 10 points",
        ),
        (
            usda(WALK, basis="bezier", wrap="nonperiodic", counts=[4, 6], more=WIDTH),
            "/c: curve 1 has 6 points, which a nonperiodic bezier curve cannot",
        ),
        (usda(WALK, basis="hermite", more=WIDTH), "/c: curves of type 'cubic', basis 'hermite'"),
        (usda(WALK, counts=[3, 7], kind="linear", more=WIDTH), "yarn 0 has 3 control points"),
        (
            usda(
                WALK,
                more=WIDTH + "\ndouble3 xformOp:scale = (1, 2, 1)\n"
                'uniform token[] xformOpOrder = ["xformOp:scale"]',
            ),
            "/c is scaled differently along its axes, so widths mean nothing; give 'radius_mm'",
        ),
        (usda(WALK, more=WIDTH).replace(repr(float(WALK[2, 1])), "nan"), "yarn 0, point 2 is not finite"),
    ],
)
@pytest.mark.usefixtures("fork")
def test_what_cannot_be_used_is_refused(tmp_path, text, message):
    with pytest.raises(InputError) as caught:
        read(tmp_path, text)
    assert str(caught.value).startswith(f"{tmp_path / 'c.usda'}: {message}")


def test_without_usd_core_the_message_says_what_to_install(tmp_path, monkeypatch):
    (tmp_path / "c.usda").write_text(usda(WALK, more=WIDTH))
    monkeypatch.setattr(usd_curves.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"need the package usd-core, .* pip install 'weft\[usd\]'"):
        read_usd(tmp_path / "c.usda")


def test_a_reader_that_hangs_or_crashes_ends_in_one_line(tmp_path, monkeypatch):
    def crash(command, **options):
        return subprocess.CompletedProcess(command, -signal.SIGSEGV, b"", b"")

    monkeypatch.setattr(usd_curves.subprocess, "run", crash)
    with pytest.raises(InputError, match=r"USD failed on this file \(exit code -11\); is it damaged\?"):
        read(tmp_path, usda(WALK, more=WIDTH))
    monkeypatch.undo()
    monkeypatch.setattr(usd_curves, "TIMEOUT_S", 0.01)
    with pytest.raises(InputError, match="USD did not come back within 0 s; is the file damaged"):
        read(tmp_path, usda(WALK, more=WIDTH))


def test_a_reader_that_never_ends_is_stopped_by_its_own_processor_time(tmp_path):
    endless = (
        "from weft.fiber_model.yarns.formats import usd_stage\n"
        "usd_stage.PROCESSOR_SECONDS = 1\n"
        f"usd_stage.write_fields(lambda: [None for _ in iter(int, 1)], {__file__!r}, 'nowhere.npz')"
    )
    done = subprocess.run([sys.executable, "-c", endless], cwd=tmp_path, timeout=120, check=False)
    assert done.returncode == -signal.SIGXCPU


@pytest.mark.parametrize(("suffix", "loops"), [("usda", True), ("usdc", False)])
@pytest.mark.parametrize("count", [50, pytest.param(250, marks=pytest.mark.proof)])
@pytest.mark.usefixtures("fork")
def test_mutants_are_read_or_refused(tmp_path, monkeypatch, suffix, loops, count):
    write_usd(a_set(loops=loops), tmp_path / f"y.{suffix}")
    whole = (tmp_path / f"y.{suffix}").read_bytes()
    monkeypatch.setattr("tests.fiber_model.yarns.formats.mutants.MOST_SECONDS", MOST_SECONDS)
    refused, good = read_mutants(read_usd, whole, tmp_path / f"m.{suffix}", count=count)
    assert min(refused, good) > 0
