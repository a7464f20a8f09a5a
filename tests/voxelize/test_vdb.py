""".vdb files: exact, complete, readable elsewhere, and never trusted."""

from __future__ import annotations

import builtins
import errno
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from weft.files.errors import InputError
from weft.voxelize import vdb, vdb_child
from weft.voxelize.grid import FiberVolume
from weft.voxelize.openvdb_library import extension, library_version

needs_openvdb = pytest.mark.skipif(library_version() is None, reason="weft was installed without OpenVDB")


def assert_same(a: FiberVolume, b: FiberVolume) -> None:
    assert a.media == b.media
    for name, grid in a.grids.items():
        other = b.grids[name]
        assert (grid.voxel_size_mm, grid.fiber_radius_mm) == (other.voxel_size_mm, other.fiber_radius_mm)
        for field in ("origins", "density", "direction"):
            assert np.array_equal(getattr(grid, field), getattr(other, field)), (name, field)


@needs_openvdb
@pytest.mark.parametrize("trusted", [True, False])
def test_round_trip_is_bit_exact(volume, tmp_path, trusted):
    vdb.write_volume(tmp_path / "a.vdb", volume)
    read = vdb.read_volume(tmp_path / "a.vdb", trusted=trusted)
    assert_same(volume, read)
    assert read.content_sha256 == volume.content_sha256 == vdb.verify(tmp_path / "a.vdb")


@needs_openvdb
def test_equal_volumes_are_equal_files(volume, tmp_path):
    for name in ("a.vdb", "b.vdb"):
        vdb.write_volume(tmp_path / name, volume)
    assert (tmp_path / "a.vdb").read_bytes() == (tmp_path / "b.vdb").read_bytes()


@needs_openvdb
def test_metadata_says_what_other_programs_need(make_grid, tmp_path):
    volume = FiberVolume({"yarn": make_grid(0, 3)})
    vdb.write_volume(tmp_path / "a.vdb", volume)
    grids = {grid["name"]: grid for grid in vdb.read_summaries(tmp_path / "a.vdb")}
    assert grids.keys() == {"density", "fiber_dir"}
    assert grids["density"]["type"] == "Tree_float_5_4_3"
    assert grids["density"]["metadata"]["class"] == "fog volume"
    assert grids["fiber_dir"]["type"] == "Tree_vec3s_5_4_3"
    assert grids["fiber_dir"]["metadata"]["vector_type"] == "contravariant relative"
    for grid in grids.values():
        metadata = grid["metadata"]
        assert metadata["units"] == "mm"
        assert metadata["fiber_radius_mm"] == 0.008
        assert metadata["schema_version"] == 2
        assert metadata["content_sha256"] == volume.content_sha256
        # voxel (i, j, k) covers [i, i + 1] h; OpenVDB's index is the voxel's center, at (i + 1/2) h
        matrix = np.reshape(grid["index_to_world"], (4, 4))
        assert np.allclose(np.array([2, -3, 5, 1]) @ matrix, [0.15, -0.15, 0.33, 1], atol=1e-12)


@needs_openvdb
def test_several_media_are_told_apart(make_grid, tmp_path):
    vdb.write_volume(tmp_path / "a.vdb", FiberVolume({"weft": make_grid(0, 2), "warp": make_grid(1, 2)}))
    names = [grid["name"] for grid in vdb.read_summaries(tmp_path / "a.vdb")]
    assert sorted(names) == ["density_warp", "density_weft", "fiber_dir_warp", "fiber_dir_weft"]


READER = """
import json, sys
try:
    import pyopenvdb as openvdb
except ImportError:
    try:
        import bpy
        bpy.utils.expose_bundled_modules()
    except ImportError:
        pass
    import openvdb
grids, _ = openvdb.readAll(sys.argv[1])
out = {}
for grid in grids:
    voxels = {",".join(map(str, v.min)): v.value for v in grid.citerOnValues() if v.count == 1}
    assert len(voxels) == grid.activeVoxelCount()
    center = grid.transform.indexToWorld((1, 2, 3))
    out[grid.name] = {"voxels": voxels, "class": grid.gridClass, "center": center}
json.dump(out, open(sys.argv[2], "w"))
"""


def other_reader() -> str:
    """A Python that reads .vdb without weft: Debian's python3-openvdb, or Blender's bpy beside weft."""
    for python in ("/usr/bin/python3", sys.executable):
        for module in ("pyopenvdb", "openvdb", "bpy"):
            probe = [python, "-c", f"import {module}"]
            if (
                Path(python).exists()
                and subprocess.run(probe, capture_output=True, check=False).returncode == 0
            ):
                return python
    pytest.skip("no other reader of .vdb here: neither python3-openvdb (apt) nor bpy (PyPI) is installed")


@needs_openvdb
def test_another_program_reads_the_same_voxels(volume, tmp_path):
    python = other_reader()
    vdb.write_volume(tmp_path / "a.vdb", volume)
    command = [python, "-c", READER, str(tmp_path / "a.vdb"), str(tmp_path / "a.json")]
    subprocess.run(command, check=True, timeout=120, env={"PATH": os.environ["PATH"]})
    found = json.loads((tmp_path / "a.json").read_text())
    local = np.stack(np.unravel_index(np.arange(512), (8, 8, 8)), axis=1)
    for medium, grid in volume.grids.items():
        suffix = "" if len(volume.media) == 1 else f"_{medium}"
        density, direction = found[f"density{suffix}"], found[f"fiber_dir{suffix}"]
        assert density["class"] == "fog volume"
        assert np.allclose(density["center"], np.array([1.5, 2.5, 3.5]) * grid.voxel_size_mm)
        brick, voxel = np.nonzero(grid.density)
        keys = [",".join(map(str, place)) for place in (grid.origins[brick] + local[voxel]).tolist()]
        assert density["voxels"].keys() == direction["voxels"].keys() == set(keys)
        values = np.array([density["voxels"][key] for key in keys], np.float32)
        axes = np.array([direction["voxels"][key] for key in keys], np.float32).reshape(-1, 3)
        assert np.array_equal(values, grid.density[brick, voxel])
        assert np.array_equal(axes, grid.direction[brick, voxel])


def test_a_missing_extension_names_the_packages(volume, tmp_path, monkeypatch):
    real_import = builtins.__import__

    def without_openvdb(name, scope=None, local=None, fromlist=(), level=0):
        if "_openvdb" in (fromlist or ()):
            raise ImportError("No module named 'weft.voxelize._openvdb'")
        return real_import(name, scope, local, fromlist, level)

    monkeypatch.setattr(builtins, "__import__", without_openvdb)
    with pytest.raises(InputError, match="libopenvdb-dev") as caught:
        vdb.write_volume(tmp_path / "a.vdb", volume)
    assert caught.value.exit_code == 2
    assert 'formats = ["nvdb"]' in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())


@needs_openvdb
@pytest.mark.parametrize("content", [b"", b"not a volume", b" BDV\0\0\0\0", b" BDV\0\0\0\0" + b"\xff" * 500])
def test_other_files_are_refused(tmp_path, content):
    path = tmp_path / "a.vdb"
    path.write_bytes(content)
    with pytest.raises(InputError, match=re.escape(str(path))) as caught:
        vdb.read_volume(path)
    assert "\n" not in str(caught.value)


@needs_openvdb
def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(InputError, match="No such file"):
        vdb.read_volume(tmp_path / "a.vdb")


@needs_openvdb
def test_truncated_files_are_refused(make_grid, tmp_path):
    path = tmp_path / "a.vdb"
    vdb.write_volume(path, FiberVolume({"yarn": make_grid(0, 8)}))
    whole = path.read_bytes()
    for part in (0.02, 0.3, 0.7, 0.999):
        path.write_bytes(whole[: int(len(whole) * part)])
        with pytest.raises(InputError):
            vdb.read_volume(path)


@needs_openvdb
def test_flipped_bytes_are_found_or_harmless(make_grid, tmp_path, monkeypatch):
    """OpenVDB's own reader loads many such files with other content, without a word.

    Some ask for as much memory as there is, and take half a minute to fill it: there is less.
    """
    monkeypatch.setattr(vdb_child, "available_memory_bytes", lambda: 1_500_000_000)
    path = tmp_path / "a.vdb"
    volume = FiberVolume({"yarn": make_grid(0, 4)})
    vdb.write_volume(path, volume)
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    messages = []
    for _ in range(12):
        mutant = bytearray(whole)
        mutant[rng.integers(8, len(whole))] ^= 1 << rng.integers(8)
        path.write_bytes(mutant)
        try:
            assert_same(vdb.read_volume(path), volume)
        except InputError as error:
            messages.append(str(error))
    assert len(messages) >= 8
    assert not [message for message in messages if "\n" in message]


@needs_openvdb
def test_any_flipped_byte_is_found(make_grid, tmp_path):
    """Metadata, names, padding and all; 400 of them and each of the first 600, where the header lies."""
    path = tmp_path / "a.vdb"
    vdb.write_volume(path, FiberVolume({"yarn": make_grid(0, 1)}))
    vdb.refuse_changed_file(path)
    whole = path.read_bytes()
    places = np.r_[:600, np.random.default_rng(0).integers(0, len(whole), 400)]
    for place in places:
        mutant = bytearray(whole)
        mutant[place] ^= 1 << (place % 8)
        path.write_bytes(mutant)
        with pytest.raises(InputError):
            vdb.refuse_changed_file(path)


@needs_openvdb
def test_changed_voxels_are_found(make_grid, tmp_path):
    """A sound file with another density than it was hashed for: nothing but the hash can tell."""
    path, volume = tmp_path / "a.vdb", FiberVolume({"yarn": make_grid(0, 4)})
    grids = list(vdb._leaf_grids(extension(), volume))
    grid = volume.grids["yarn"]
    brick, voxel = np.argwhere(grid.density)[0]
    grid.density[brick, voxel] *= np.float32(1.0001)
    extension().write_grids(str(path), grids)
    with pytest.raises(InputError, match="content_sha256"):
        vdb.read_volume(path)
    assert (
        vdb.read_volume(path, verify=False).grids["yarn"].density[brick, voxel] == grid.density[brick, voxel]
    )


@needs_openvdb
def test_files_from_elsewhere_are_refused_in_words(make_grid, tmp_path):
    path, grid = tmp_path / "a.vdb", make_grid(0, 2)
    foreign = extension().LeafGrid(
        "density", grid.origins, grid.masks, grid.density, voxel_size=0.1, translation=[0, 0, 0]
    )
    extension().write_grids(str(path), [foreign])
    with pytest.raises(InputError, match="no grid 'density' written by weft"):
        vdb.read_volume(path)


@needs_openvdb
def test_a_reader_that_hangs_is_stopped(volume, tmp_path):
    vdb.write_volume(tmp_path / "a.vdb", volume)
    with pytest.raises(InputError, match=r"took over 0\.001 s"):
        vdb_child.read_in_child(tmp_path / "a.vdb", with_leaves=True, seconds=0.001)


@needs_openvdb
def test_the_reading_process_loads_no_numpy():
    """`weft render` waits for it, and numpy alone takes longer to load than OpenVDB."""
    code = "import sys, weft.voxelize.vdb_reader; print('numpy' in sys.modules)"
    command = [sys.executable, "-c", code]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == "False\n"


@needs_openvdb
def test_a_volume_begun_early_is_the_volume(volume, tmp_path):
    vdb.write_volume(tmp_path / "a.vdb", volume)
    assert vdb.begin_volume(tmp_path / "a.vdb")().content_sha256 == volume.content_sha256


@needs_openvdb
def test_a_reader_that_wants_too_much_memory_is_stopped(make_grid, tmp_path):
    vdb.write_volume(tmp_path / "a.vdb", FiberVolume({"yarn": make_grid(0, 8000, fill=0.001)}))
    with pytest.raises(InputError, match="cannot be read"):
        vdb_child.read_in_child(tmp_path / "a.vdb", with_leaves=True, memory_bytes=200 * 2**20)


WRITER = """
import resource, signal, sys
from weft.voxelize import vdb
from weft.files.errors import InputError
volume = vdb.read_volume(sys.argv[1], trusted=True)
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000))
try:
    vdb.write_volume(sys.argv[2], volume)
except (InputError, RuntimeError, OSError) as error:
    print(type(error).__name__)
"""


@needs_openvdb
def test_a_failed_write_leaves_the_earlier_file(make_grid, tmp_path):
    """Writes fail beyond 20 kB, as on a full disk; libopenvdb's own writer would report nothing."""
    vdb.write_volume(tmp_path / "big.vdb", FiberVolume({"yarn": make_grid(0, 30)}))
    target = tmp_path / "target.vdb"
    vdb.write_volume(target, FiberVolume({"yarn": make_grid(1, 2)}))
    before = target.read_bytes()
    command = [sys.executable, "-c", WRITER, str(tmp_path / "big.vdb"), str(target)]
    result = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
    assert result.stdout.strip() == "DiskSpaceError", result.stderr
    assert target.read_bytes() == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["big.vdb", "target.vdb"]


@needs_openvdb
def test_a_full_disk_is_named(volume):
    grids = list(vdb._leaf_grids(extension(), volume))
    with pytest.raises(OSError, match="No space left on device") as caught:
        extension().write_grids("/dev/full", grids)
    # what atomic_write turns into a DiskSpaceError
    assert caught.value.errno == errno.ENOSPC
