"""smobj's .yarns: chunks, and the quadratic B-spline that its viewers draw."""

import struct

import numpy as np
import pytest

from tests.fiber_model.yarns.formats.mutants import read_mutants
from tests.fiber_model.yarns.formats.test_follow import dense, distance_to_polyline, smooth_walk
from weft.fiber_model.yarns.catmull_rom import CatmullRom
from weft.fiber_model.yarns.formats.follow import TOLERANCE
from weft.fiber_model.yarns.formats.smobj_yarns import read_smobj_yarns
from weft.files.errors import InputError

RADIUS = 0.25


def chunk(tag, data):
    return tag + struct.pack("<I", len(data)) + data


def yarns_bytes(curves, *, radius=RADIUS, ranges=None, rest=b""):
    counts = [len(curve) for curve in curves]
    ends = np.cumsum(counts)
    ranges = list(zip(ends - counts, ends, strict=True)) if ranges is None else ranges
    points = np.concatenate(curves).astype("<f4")
    table = b"".join(struct.pack("<IIf4B", *pair, radius, 9, 8, 7, 255) for pair in ranges)
    lines = np.arange(len(points), dtype="<u4").tobytes()
    return chunk(b"f3..", points.tobytes()) + chunk(b"src.", lines) + chunk(b"yarn", table) + rest


def drawn(points, closed):
    """The curve as smobj's viewers draw it: the ends, and parabolas from middle to middle of the edges."""
    middle = 0.5 * (points[:-1] + points[1:])
    t = np.linspace(0, 1, 60)[:, None]
    parts = [
        (1 - t) ** 2 * middle[k] + 2 * t * (1 - t) * points[k + 1] + t**2 * middle[k + 1]
        for k in range(len(points) - 2)
    ]
    if closed:
        last = (1 - t) ** 2 * middle[-1] + 2 * t * (1 - t) * points[0] + t**2 * middle[0]
        return np.concatenate([*parts, last])
    return np.concatenate([points[:1], *parts, points[-1:]])


@pytest.fixture
def curves():
    angle = np.arange(9) * 2 * np.pi / 8
    loop = np.stack([2 * np.cos(angle), 2 * np.sin(angle), 0 * angle], axis=1)
    loop[-1] = loop[0]
    return [
        smooth_walk(12, 5).astype(np.float32),
        loop.astype(np.float32),
        smooth_walk(3, 6).astype(np.float32),
    ]


def test_yarns_are_the_curves_that_smobj_draws(tmp_path, curves):
    (tmp_path / "k.yarns").write_bytes(yarns_bytes(curves))
    yarns = read_smobj_yarns(tmp_path / "k.yarns", scale_to_mm=3.0)
    assert yarns.closed.tolist() == [False, True, False]
    assert yarns.radius.tolist() == [3.0 * RADIUS] * 3
    segments = CatmullRom.through(yarns)
    for yarn, curve in enumerate(curves):
        own = segments.coefficients[segments.offsets[yarn] : segments.offsets[yarn + 1]]
        made, wanted = dense(own, 12), drawn(3.0 * curve.astype(np.float64), yarns.closed[yarn])
        assert distance_to_polyline(made, wanted).max() < TOLERANCE * 3.0 * RADIUS
        assert distance_to_polyline(wanted, made).max() < TOLERANCE * 3.0 * RADIUS + 1e-3


def test_later_chunks_are_skipped_and_z_may_be_up(tmp_path, curves):
    rest = chunk(b"strs", b"1") + chunk(b"unit", struct.pack("<IIf", 0, 1, 1.0)) + chunk(b"chk.", b"")
    (tmp_path / "k.yarns").write_bytes(yarns_bytes(curves, rest=rest))
    yarns = read_smobj_yarns(tmp_path / "k.yarns", scale_to_mm=1.0, up_axis=2, radius_mm=0.5)
    assert yarns.radius.tolist() == [0.5] * 3
    x, y, z = curves[0][0].astype(np.float64)
    assert yarns.yarn(0)[0] == pytest.approx([x, z, -y], abs=1e-9)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda c: b"", "byte 0: no chunk 'f3..'. Is the file truncated?"),
        (lambda c: b"f3..", "byte 0: the file ends within the head of a chunk"),
        (lambda c: b"BCC." + bytes(8), "byte 0: chunk 'BCC.'; need 'f3..'"),
        (
            lambda c: b"f3.." + struct.pack("<I", 2**32 - 4) + bytes(24),
            "byte 0: chunk 'f3..' of 4294967292 bytes; need a multiple of 12, at most 24. "
            "Is the file truncated?",
        ),
        (
            lambda c: yarns_bytes(c, ranges=[(0, 25)]),
            "byte 408: yarn 0 has points 0 to 25, but there are 24, each for one yarn",
        ),
        (
            lambda c: yarns_bytes(c, ranges=[(0, 20), (5, 24)]),
            "byte 424: yarn 1 has points 5 to 24, but there are 24, each for one yarn",
        ),
        (
            lambda c: yarns_bytes(c, ranges=[(0, 1)]),
            "byte 408: yarn 0 has 1 control point; a yarn here needs at least 2",
        ),
        (
            lambda c: yarns_bytes([c[0] * np.float32(np.nan)]),
            "byte 8: yarn 0, point 0 is not finite: (nan, nan, nan)",
        ),
        (lambda c: yarns_bytes(c, radius=-1.0), " yarn 0 has radius -1 mm; need a positive number"),
        (lambda c: yarns_bytes(c, ranges=[]), " there are no yarns; need at least one"),
    ],
)
def test_damaged_files_are_refused(tmp_path, curves, make, message):
    path = tmp_path / "k.yarns"
    path.write_bytes(make(curves))
    with pytest.raises(InputError) as caught:
        read_smobj_yarns(path, scale_to_mm=1.0)
    assert str(caught.value) == f"{path}:{message}"


def test_mutants_are_read_or_refused(tmp_path, curves):
    read_mutants(
        lambda path: read_smobj_yarns(path, scale_to_mm=1.0), yarns_bytes(curves), tmp_path / "m.yarns"
    )
