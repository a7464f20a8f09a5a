"""The extension refuses what would corrupt a tree, and its build stands aside where OpenVDB is missing."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from weft.voxelize.openvdb_library import extension, library_version

SOURCE = Path(__file__).parents[2] / "voxelize"
needs_openvdb = pytest.mark.skipif(library_version() is None, reason="weft was installed without OpenVDB")
needs_cmake = pytest.mark.skipif(shutil.which("cmake") is None, reason="cmake is not installed")


@pytest.fixture
def leaves(make_grid) -> dict:
    grid = make_grid(0, 4)
    return {"origins": grid.origins, "masks": grid.masks, "values": grid.density, "voxel_size": 0.1}


def write(tmp_path: Path, leaves: dict) -> None:
    grid = extension().LeafGrid("density", translation=[0, 0, 0], **leaves)
    extension().write_grids(str(tmp_path / "a.vdb"), [grid])


@needs_openvdb
@pytest.mark.parametrize(
    ("field", "spoil", "message"),
    [
        ("origins", lambda a: a + 1, "not a multiple of 8"),
        ("origins", lambda a: np.repeat(a[:1], len(a), axis=0), "repeats"),
        ("origins", lambda a: np.where(a == a[0], np.int32(2**30), a), "beyond 2\\^30"),
        ("origins", lambda a: np.where(a == a[0], np.int32(-(2**31)), a), "beyond 2\\^30"),
        ("masks", lambda a: a[:-1], "differ in length"),
        ("values", lambda a: a[:-1], "differ in length"),
        ("values", lambda a: np.ascontiguousarray(a[:, :500]), "512 voxels"),
        ("values", lambda a: np.repeat(a[..., None], 2, axis=2), "3 components"),
        ("values", lambda a: a[0], "2 or 3 axes|512 voxels|differ"),
        ("voxel_size", lambda a: float("nan"), "not positive"),
        ("voxel_size", lambda a: -0.1, "not positive"),
    ],
)
def test_malformed_leaves_are_refused(leaves, tmp_path, field, spoil, message):
    with pytest.raises(ValueError, match=message):
        write(tmp_path, {**leaves, field: spoil(leaves[field])})
    assert not list(tmp_path.iterdir())


@needs_openvdb
@pytest.mark.parametrize("field", ["origins", "masks", "values"])
def test_wrong_types_are_refused(leaves, tmp_path, field):
    with pytest.raises(TypeError):
        write(tmp_path, {**leaves, field: leaves[field].astype(np.float64)})


@needs_openvdb
@pytest.mark.parametrize("field", ["grid_class", "vector_type"])
def test_unknown_conventions_are_refused(leaves, tmp_path, field):
    with pytest.raises(ValueError, match="contravariant_relative"):
        write(tmp_path, {**leaves, field: "contravariant_relative"})


@needs_openvdb
def test_strided_arrays_are_refused_rather_than_misread(leaves, tmp_path):
    with pytest.raises(TypeError):
        write(tmp_path, {**leaves, "values": np.asfortranarray(leaves["values"])})


@needs_openvdb
def test_metadata_keeps_its_types(leaves, tmp_path):
    metadata = {"a": 2**40, "b": 0.1, "c": "text", "d": True}
    grid = extension().LeafGrid("density", translation=[0, 0, 0], metadata=metadata, **leaves)
    extension().write_grids(str(tmp_path / "a.vdb"), [grid])
    found = extension().read_grids(str(tmp_path / "a.vdb"), with_leaves=False)[0]["metadata"]
    assert {key: found[key] for key in metadata} == metadata


@needs_openvdb
def test_reading_stops_at_the_limit_of_leaves(leaves, tmp_path):
    write(tmp_path, leaves)
    with pytest.raises(ValueError, match="more than 2 leaves"):
        extension().read_grids(str(tmp_path / "a.vdb"), max_leaves=2)


@needs_openvdb
def test_comparing_sees_a_changed_value(leaves, tmp_path):
    write(tmp_path, leaves)
    grid = extension().LeafGrid("density", translation=[0, 0, 0], **leaves)
    extension().compare_grids(str(tmp_path / "a.vdb"), [grid])
    leaves["values"][-1, -1] += 1
    with pytest.raises(RuntimeError, match="values differ"):
        extension().compare_grids(str(tmp_path / "a.vdb"), [grid])


@needs_cmake
@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (
            ["-DOPENVDB_INCLUDE=OPENVDB_INCLUDE-NOTFOUND", "-DCMAKE_IGNORE_PREFIX_PATH=/usr;/usr/local;/"],
            "OpenVDB",
        ),
        (
            [
                "-DCMAKE_CXX_COMPILER=NOTFOUND",
                *[f"-D{name}=/" for name in ("OPENVDB_INCLUDE", "BOOST_INCLUDE", "IMATH_INCLUDE")],
                *[f"-D{name}=/" for name in ("OPENVDB_LIBRARY", "TBB_LIBRARY")],
            ],
            "C\\+\\+ compiler",
        ),
        (["-DPython_INCLUDE_DIR=/nowhere", "-DPython_EXECUTABLE=/nowhere/python"], "headers of Python"),
    ],
)
def test_the_build_stands_aside(tmp_path, options, reason):
    # nanobind is there while weft is being built, and only then
    (tmp_path / "nanobindConfig.cmake").write_text(
        "function(nanobind_add_module name static)\nadd_library(${name} MODULE ${ARGN})\nendfunction()\n"
    )
    nanobind = f"-Dnanobind_DIR={tmp_path}"
    command = ["cmake", "-S", str(SOURCE), "-B", str(tmp_path / "build"), nanobind, *options]
    result = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert result.returncode == 0, result.stderr
    warning = " ".join(result.stderr.split())
    assert "weft installs without .vdb support" in warning
    assert "apt-get install" in warning
    assert reason.replace("\\", "") in warning
