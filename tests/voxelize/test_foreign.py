"""Volumes that other programs wrote: read where they are whole, refused in one line where they are not."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from weft.files.errors import InputError
from weft.voxelize import vdb, vdb_child
from weft.voxelize.config import ForeignVolumeConfig
from weft.voxelize.foreign import MEDIUM, read_foreign
from weft.voxelize.openvdb_library import extension, library_version

pytestmark = pytest.mark.skipif(library_version() is None, reason="weft was installed without OpenVDB")

CONFIG = ForeignVolumeConfig(fiber_radius_mm=0.01)
SYSTEM_PYTHON = Path("/usr/bin/python3")

# a box of fog with directions along a slanted axis, the way Houdini writes it: centers at whole indices
WRITER = """
import sys, numpy as np, pyopenvdb as vdb
density, tangent, other = vdb.FloatGrid(), vdb.Vec3SGrid(), vdb.BoolGrid()
rng = np.random.default_rng(0)
values = rng.uniform(0.1, 0.9, (12, 9, 20)).astype(np.float32)
axes = np.broadcast_to(np.array([0.6, 0.0, -2.0], np.float32), (12, 9, 20, 3)).copy()
density.copyFromArray(values, ijk=(-3, 5, 100))
tangent.copyFromArray(axes, ijk=(-3, 5, 100))
other.copyFromArray(values > 0.5)
density.name, tangent.name, other.name = "density", sys.argv[2], "mask"
for grid in (density, tangent, other):
    grid.transform = vdb.createLinearTransform(voxelSize=0.0005)
density.gridClass = vdb.GridClass.FOG_VOLUME
density["creator"] = "Houdini/GEO_VDBTranslator"
vdb.write(sys.argv[1], grids=[density, tangent, other])
np.save(sys.argv[1] + ".npy", values)
"""


def write_elsewhere(path: Path, direction: str) -> np.ndarray:
    probe = [SYSTEM_PYTHON, "-c", "import pyopenvdb, numpy"]
    if not SYSTEM_PYTHON.exists() or subprocess.run(probe, capture_output=True, check=False).returncode:
        pytest.skip("python3-openvdb (apt) is not installed")
    command = [SYSTEM_PYTHON, "-c", WRITER, str(path), direction]
    subprocess.run(command, check=True, timeout=120, env={"PATH": os.environ["PATH"]})
    return np.load(f"{path}.npy")


@pytest.mark.parametrize("name", ["tangentu", "velocity", "a name of its own"])
def test_a_file_of_another_program_is_read(tmp_path, name):
    """Every voxel where it was, up to half of one; meters become millimeters."""
    values = write_elsewhere(tmp_path / "a.vdb", name)
    config = CONFIG.model_copy(update={"scale_to_mm": 1000.0, "density_scale": 0.5})
    volume = read_foreign(tmp_path / "a.vdb", config)
    grid = volume.grids[MEDIUM]
    assert grid.voxel_size_mm == pytest.approx(0.5)
    assert volume.about["direction_grid"] == name
    assert volume.about["voxels_without_direction"] == 0
    grid.check_values()
    brick, voxel = np.nonzero(grid.density)
    place = grid.origins[brick] + np.stack(np.unravel_index(voxel, (8, 8, 8)), axis=1)
    # its centers lie at 0.5 i mm, ours at 0.5 (i + 1/2) mm
    low = place.min(axis=0)
    assert np.abs((low + 0.5) - [-3, 5, 100]).max() <= 0.5
    dense = np.zeros(values.shape, np.float32)
    dense[tuple((place - low).T)] = grid.density[brick, voxel]
    assert np.array_equal(dense, values * np.float32(0.5))
    axis = np.array([-0.6, 0.0, 2.0]) / np.hypot(0.6, 2.0)
    assert np.abs(grid.direction[brick, voxel] - axis).max() < 1e-6


def leaf_grid(grid, name: str, values: np.ndarray, **kind):
    place = {"voxel_size": 0.1, "translation": [0.05] * 3} | kind
    return extension().LeafGrid(name, grid.origins, grid.masks, values, **place)


def write(path: Path, *grids) -> Path:
    extension().write_grids(str(path), list(grids))
    return path


def test_a_volume_of_weft_comes_back_whole(volume, tmp_path):
    """Through the names alone, without its metadata."""
    grid = next(iter(volume.grids.values()))
    path = write(
        tmp_path / "a.vdb", leaf_grid(grid, "density", grid.density), leaf_grid(grid, "dir", grid.direction)
    )
    read = read_foreign(path, CONFIG).grids[MEDIUM]
    assert np.array_equal(read.origins, grid.origins)
    assert np.array_equal(read.density, grid.density)
    assert np.abs(read.direction - grid.direction).max() < 1e-6


def test_voxels_without_direction_take_the_main_axis(make_grid, tmp_path):
    grid = make_grid(0, 5)
    along_y = np.zeros_like(grid.direction)
    along_y[grid.density > 0.5] = [0, -3, 0]
    read = read_foreign(
        write(tmp_path / "a.vdb", leaf_grid(grid, "density", grid.density), leaf_grid(grid, "dir", along_y)),
        CONFIG,
    )
    assert read.about["voxels_without_direction"] == int(((grid.density > 0) & (grid.density <= 0.5)).sum())
    inside = read.grids[MEDIUM].density > 0
    assert np.allclose(read.grids[MEDIUM].direction[inside], [0, 1, 0])


def refused(path: Path, match: str, **config) -> None:
    with pytest.raises(InputError, match=match) as caught:
        read_foreign(path, CONFIG.model_copy(update=config))
    assert caught.value.exit_code == 2
    assert "\n" not in str(caught.value)


def test_what_is_missing_is_named(make_grid, tmp_path):
    grid = make_grid(0, 3)
    density, axes = leaf_grid(grid, "density", grid.density), leaf_grid(grid, "dir", grid.direction)
    path = write(tmp_path / "a.vdb", density)
    refused(path, r"no vec3s grid that might be the direction; its grids: density \(float\)")
    refused(write(path, axes), "no float grid that might be the density")
    refused(write(path, density, axes), "has no float grid 'smoke'", density="smoke")
    others = [leaf_grid(grid, name, grid.direction) for name in ("a", "b")]
    refused(write(path, density, *others), "several vec3s grids")
    level_set = leaf_grid(grid, "density", grid.density, grid_class="level set")
    refused(write(path, level_set, axes), "level set")
    moved = leaf_grid(grid, "dir", grid.direction, voxel_size=0.2)
    refused(write(path, density, moved), "different transforms")
    refused(write(path, density, leaf_grid(grid, "dir", 0 * grid.direction)), "zero wherever")
    refused(write(path, leaf_grid(grid, "density", -grid.density), axes), "negative or not finite")
    with pytest.raises(InputError, match=r"\[render.foreign\]"):
        vdb.read_volume(write(path, density, axes))


def test_damaged_files_of_other_programs_end_in_one_line(make_grid, tmp_path, monkeypatch):
    """20 single bytes changed, and 3 truncated files: read or refused, never a crash or a hang.

    Some turn tiles on that stand for a million leaves: there is memory for fewer.
    """
    monkeypatch.setattr(vdb_child, "available_memory_bytes", lambda: 1_500_000_000)
    grid = make_grid(0, 3)
    path = write(
        tmp_path / "a.vdb", leaf_grid(grid, "density", grid.density), leaf_grid(grid, "dir", grid.direction)
    )
    whole, rng = path.read_bytes(), np.random.default_rng(1)
    mutants = [whole[: int(len(whole) * part)] for part in (0.1, 0.5, 0.99)]
    for _ in range(20):
        mutant = bytearray(whole)
        mutant[rng.integers(8, 2000)] ^= 1 << rng.integers(8)
        mutants.append(bytes(mutant))
    messages = []
    for content in mutants:
        path.write_bytes(content)
        try:
            read_foreign(path, CONFIG)
        except InputError as error:
            messages.append(str(error))
    assert len(messages) >= 3
    assert not [message for message in messages if "\n" in message]
