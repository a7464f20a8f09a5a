"""Whole leaves out of files that others wrote: compressed, with backgrounds, half floats and tiles."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest

from weft.voxelize.openvdb_library import extension, library_version
from weft.voxelize.vdb_child import read_in_child

SYSTEM_PYTHON = "/usr/bin/python3"
pytestmark = pytest.mark.skipif(library_version() is None, reason="weft was installed without OpenVDB")

WRITE = """
import sys
import numpy as np
import pyopenvdb as openvdb
kind, folder, low, size = sys.argv[1], sys.argv[2], -24, 48
rng = np.random.default_rng(0)
if kind == "level set":
    grid = openvdb.createLevelSetSphere(radius=15.0)
elif kind == "vectors":
    grid = openvdb.Vec3SGrid((0.5, 0.0, -1.0))
    grid.copyFromArray(rng.normal(size=(20, 20, 20, 3)).astype(np.float32), ijk=(-11, 3, 0))
else:
    grid = openvdb.FloatGrid({"fog": 0.0, "background": 0.25, "half": 0.0, "tiles": 0.0}[kind])
    values = rng.uniform(0.1, 1.0, (20, 20, 20)).astype(np.float32)
    values[rng.random(values.shape) < 0.6] = grid.background
    grid.copyFromArray(values, ijk=(-11, 3, 0))
    grid.saveFloatAsHalf = kind == "half"
    if kind == "tiles":
        grid.fill((-16, -16, -16), (-9, -9, -9), 0.75)
grid.name = "density"
openvdb.write(folder + "/a.vdb", [grid])
grid = openvdb.readAll(folder + "/a.vdb")[0][0]
dense = np.zeros((size,) * 3 + ((3,) if kind == "vectors" else ()), np.float32)
grid.copyToArray(dense, ijk=(low,) * 3)
np.save(folder + "/dense.npy", dense)
print(grid.activeVoxelCount())
"""


def dense_of(grid: dict, shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Values of the leaves in a box that begins at (-24, -24, -24), and where there are leaves."""
    dense, there = np.zeros(shape, np.float32), np.zeros(shape[:3], bool)
    for origin, values in zip(grid["leaves"]["origins"], grid["leaves"]["values"], strict=True):
        box = tuple(slice(at + 24, at + 32) for at in origin)
        dense[box], there[box] = values.reshape(8, 8, 8, *shape[3:]), True
    return dense, there


@pytest.mark.parametrize("kind", ["fog", "background", "half", "tiles", "level set", "vectors"])
def test_leaves_are_those_another_program_wrote(kind, tmp_path):
    command = [SYSTEM_PYTHON, "-c", WRITE, kind, str(tmp_path)]
    written = subprocess.run(command, capture_output=True, text=True, check=False)
    if "No module named" in written.stderr:
        pytest.skip("python3-openvdb is not installed")
    assert written.returncode == 0, written.stderr
    expected = np.load(tmp_path / "dense.npy")
    (here,) = extension().read_grids(str(tmp_path / "a.vdb"))
    (child,) = read_in_child(tmp_path / "a.vdb", with_leaves=True)
    dense, there = dense_of(here, expected.shape)
    assert there.sum() >= 512
    assert np.array_equal(dense[there], expected[there])
    assert np.bitwise_count(here["leaves"]["masks"]).sum() == int(written.stdout)
    for name, array in here["leaves"].items():
        assert np.array_equal(array, child["leaves"][name])
        assert array.dtype == child["leaves"][name].dtype
    assert here["metadata"] == child["metadata"]


def test_file_that_ends_within_a_grid_is_refused(make_grid, tmp_path):
    grid = make_grid(0, 40)
    leaves = extension().LeafGrid(
        "density", grid.origins, grid.masks, grid.density, voxel_size=0.1, translation=[0, 0, 0]
    )
    path = Path(tmp_path / "a.vdb")
    extension().write_grids(str(path), [leaves])
    whole = path.read_bytes()
    assert len(extension().read_grids(str(path))[0]["leaves"]["origins"]) == grid.brick_count
    for kept in (0.9, 0.5, 0.2):
        path.write_bytes(whole[: int(kept * len(whole))])
        with pytest.raises((RuntimeError, ValueError, IndexError)):
            extension().read_grids(str(path))
