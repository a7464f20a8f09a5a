"""A [yarns] table of kind "file" finds the reader, the unit, the radius and the frame."""

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from tests.fiber_model.yarns.formats.test_bccx import write_bccx
from tests.fiber_model.yarns.formats.test_cyhair import hair_bytes
from tests.fiber_model.yarns.formats.test_follow import smooth_walk
from tests.fiber_model.yarns.formats.test_mitsuba_hair import binary, text
from tests.fiber_model.yarns.formats.test_smobj_yarns import yarns_bytes
from weft.fiber_model.yarns.build import run
from weft.fiber_model.yarns.config import NOT_IN_FILE, YarnsConfig
from weft.fiber_model.yarns.formats.bcc import write_bcc
from weft.fiber_model.yarns.formats.usd_export import write_usd
from weft.fiber_model.yarns.yarn_file import save_yarns
from weft.fiber_model.yarns.yarns import YarnSet
from weft.files.errors import InputError
from weft.files.input_file import TextFromFile

CONFIG = TypeAdapter(YarnsConfig)
WALK = smooth_walk(8, 2).astype(np.float32).astype(np.float64)
YARNS = YarnSet.checked([WALK], radius=0.25)


def build(**table):
    return run(CONFIG.validate_python({"kind": "file"} | table))


def write(path):
    """The walk in a file of the kind that the suffix asks for."""
    points = [WALK.astype(np.float32)]
    ids = range(1, len(WALK) + 1)
    rows = [f"{x!r} {y!r} {z!r}" for x, y, z in WALK.tolist()]
    match path.suffix:
        case ".npz":
            save_yarns(YARNS, path)
        case ".bcc":
            write_bcc(YARNS, path)
        case ".bccx":
            write_bccx(YARNS, path)
        case ".usd" | ".usda" | ".usdc":
            pytest.importorskip("pxr", reason="usd-core is not installed; pip install usd-core")
            write_usd(YARNS, path)
        case ".hair":
            path.write_bytes(hair_bytes(points))
        case ".mitshair":
            path.write_bytes(binary(points))
        case ".yarns":
            path.write_bytes(yarns_bytes(points))
        case ".obj":
            vertices = "".join(f"v {row}\n" for row in rows)
            path.write_text(vertices + "l " + " ".join(map(str, ids)))
        case ".poly":
            named = "".join(f"{k}: {row}\n" for k, row in zip(ids, rows, strict=True))
            path.write_text(f"POINTS\n{named}POLYS\n1: {' '.join(map(str, ids))}\nEND\n")


@pytest.mark.parametrize("suffix", NOT_IN_FILE)
def test_every_kind_of_file_is_read(tmp_path, suffix):
    path = tmp_path / f"walk{suffix}"
    write(path)
    given = {"scale_to_mm": 1.0} if NOT_IN_FILE[suffix] else {}
    yarns = build(file=path, radius_mm=0.5, **given)
    assert yarns.radius.tolist() == [0.5]
    if suffix != ".yarns":  # a B-spline, which does not pass through its points
        assert np.array_equal(yarns.points, WALK)


@pytest.mark.parametrize(
    ("suffix", "key"), [(suffix, key) for suffix, keys in NOT_IN_FILE.items() for key in keys]
)
def test_what_a_file_never_holds_must_be_given(tmp_path, suffix, key):
    path = tmp_path / f"walk{suffix}"
    write(path)
    given = {"scale_to_mm": 1.0, "radius_mm": 1.0}
    del given[key]
    with pytest.raises(ValidationError, match=rf"'{key}' must be given"):
        build(file=path, **given)


def test_a_hair_file_may_be_cyhair_or_mitsuba(tmp_path):
    points = [WALK.astype(np.float32)]
    for data in (hair_bytes(points), binary(points), text(points)):
        (tmp_path / "w.hair").write_bytes(data)
        assert np.array_equal(build(file=tmp_path / "w.hair", scale_to_mm=1, radius_mm=1).points, WALK)
    with pytest.raises(InputError, match="holds no radius"):
        build(file=tmp_path / "w.hair", scale_to_mm=1)


@pytest.mark.parametrize("name", ["frame_%04d.bcc", "frame_%d.bcc", "frame_%4d.bcc"])
@pytest.mark.parametrize("relative", [False, True])
def test_a_frame_of_a_sequence(tmp_path, name, relative):
    for frame in (7, 12):
        write_bcc(YarnSet.checked([WALK + frame], radius=1.0), tmp_path / (name % frame))
    file = TextFromFile(name, tmp_path) if relative else tmp_path / name
    options = {"file": file, "scale_to_mm": 1.0, "radius_mm": 1.0}
    assert build(frame=12, **options).points == pytest.approx(WALK + 12, abs=1e-5)
    config = CONFIG.validate_python({"kind": "file", "frame": 7} | options)
    assert config.file == tmp_path / (name % 7)
    assert CONFIG.validate_python(config.model_dump()) == config
    with pytest.raises(ValidationError, match="is the name of a sequence, so 'frame' must be given"):
        build(**options)
    with pytest.raises(ValidationError, match="file not found"):
        build(frame=8, **options)
    with pytest.raises(ValidationError, match="valid integer"):
        build(frame="seven", **options)


def test_a_frame_needs_a_sequence(tmp_path):
    write(tmp_path / "walk.bcc")
    with pytest.raises(ValidationError, match=r"'frame' needs a place in the name, as in 'frame_%04d\.bcc'"):
        build(file=tmp_path / "walk.bcc", scale_to_mm=1, radius_mm=1, frame=3)
