""".nvdb files: exact, laid out as NanoVDB has it, and never trusted."""

from __future__ import annotations

import re

import numpy as np
import pytest
import warp as wp

from weft.files.errors import InputError
from weft.voxelize import nanovdb
from weft.voxelize.grid import FiberVolume


@wp.kernel
def look_up(
    density: wp.uint64, direction: wp.uint64, places: wp.array(dtype=wp.vec3i), out: wp.array2d(dtype=float)
):
    i = wp.tid()
    p = places[i]
    out[i, 0] = wp.volume_lookup_f(density, p[0], p[1], p[2])
    axis = wp.volume_lookup_v(direction, p[0], p[1], p[2])
    for k in range(3):
        out[i, k + 1] = axis[k]


def load_all(path) -> list[wp.Volume]:
    with open(path, "rb") as file:
        volumes = [wp.Volume.load_from_nvdb(file, device="cpu")]
    while (following := volumes[-1].load_next_grid()) is not None:
        volumes.append(following)
    return volumes


def test_round_trip_is_bit_exact(volume, tmp_path):
    path = tmp_path / "a.nvdb"
    nanovdb.write_volume(path, volume)
    read = nanovdb.read_volume(path)
    assert read.media == volume.media
    for name, grid in volume.grids.items():
        other = read.grids[name]
        assert (grid.voxel_size_mm, grid.fiber_radius_mm) == (other.voxel_size_mm, other.fiber_radius_mm)
        for field in ("origins", "density", "direction"):
            assert np.array_equal(getattr(grid, field), getattr(other, field))
    assert read.content_sha256 == volume.content_sha256


def test_equal_volumes_are_equal_files(volume, tmp_path):
    for name in ("a.nvdb", "b.nvdb"):
        nanovdb.write_volume(tmp_path / name, volume)
    assert (tmp_path / "a.nvdb").read_bytes() == (tmp_path / "b.nvdb").read_bytes()


def test_warp_looks_up_the_same_voxels(make_grid, tmp_path):
    grid = make_grid(0, 12)
    nanovdb.write_volume(tmp_path / "a.nvdb", FiberVolume({"yarn": grid}))
    density, direction = load_all(tmp_path / "a.nvdb")
    assert [v.get_grid_info().name for v in (density, direction)] == ["density", "fiber_dir"]
    # voxel (i, j, k) covers [i, i + 1] h, so its center, where NanoVDB puts the index, lies at (i + 1/2) h
    assert np.allclose(density.get_grid_info().translation, 0.03)
    assert np.allclose(density.get_voxel_size(), 0.06)
    local = np.stack(np.unravel_index(np.arange(512), (8, 8, 8)), axis=1)
    places = (grid.origins[:, None] + local).reshape(-1, 3)
    outside = np.full((1, 3), 5000)
    where = wp.array(np.concatenate([places, outside]).astype(np.int32), dtype=wp.vec3i, device="cpu")
    out = wp.empty((len(places) + 1, 4), dtype=float, device="cpu")
    wp.launch(look_up, dim=len(out), inputs=[density.id, direction.id, where, out], device="cpu")
    found = out.numpy()
    assert np.array_equal(found[:-1, 0], grid.density.ravel())
    assert np.array_equal(found[:-1, 1:], grid.direction.reshape(-1, 3))
    assert not found[-1].any()


def test_head_says_what_other_programs_need(make_grid, tmp_path):
    """pbrt-v4 looks for a grid named density whose class is fog volume, by the entries ahead of the grids."""
    grid = make_grid(1, 5)
    path = tmp_path / "a.nvdb"
    nanovdb.write_volume(path, FiberVolume({"yarn": grid}))
    content = path.read_bytes()
    head = np.frombuffer(content, nanovdb.FILE_HEAD, 1)[0]
    entry = np.frombuffer(content, nanovdb.ENTRY, 1, offset=16)[0]
    assert (nanovdb.FILE_HEAD.itemsize, nanovdb.ENTRY.itemsize) == (16, 176)
    assert head["magic"] == b"NanoVDB0"
    assert (head["count"], head["codec"]) == (2, 0)
    assert content[192:200] == b"density\0"
    assert (entry["grid_type"], entry["grid_class"]) == (1, 2)
    assert entry["voxel_count"] == grid.voxel_count
    assert entry["node_count"][0] == grid.brick_count
    assert entry["index_bounds"][:3].tolist() == grid.origins.min(axis=0).tolist()
    assert len(content) == 16 + 2 * 176 + len("density fiber_dir ") + sum(
        np.frombuffer(content, nanovdb.ENTRY, 1, offset=start)[0]["grid_bytes"] for start in (16, 200)
    )


def test_inactive_voxels_are_masked_out(make_grid, tmp_path):
    grid = make_grid(2, 5)
    nanovdb.write_volume(tmp_path / "a.nvdb", FiberVolume({"yarn": grid}))
    loaded = load_all(tmp_path / "a.nvdb")[0]
    leaves = nanovdb._leaves(loaded.array().numpy(), 1)
    order = np.lexsort(leaves["origin"].T[::-1])
    assert np.array_equal(leaves["mask"][order], grid.masks)


@pytest.mark.parametrize("content", [b"", b"not a volume", b"NanoVDB0", b"NanoVDB0" + b"\xff" * 500])
def test_other_files_are_refused(tmp_path, content):
    path = tmp_path / "a.nvdb"
    path.write_bytes(content)
    with pytest.raises(InputError, match=re.escape(str(path))):
        nanovdb.read_volume(path)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(InputError, match="No such file"):
        nanovdb.read_volume(tmp_path / "a.nvdb")


def test_grids_of_other_programs_are_refused(tmp_path):
    path = tmp_path / "a.nvdb"
    tiles = wp.array(np.zeros((1, 3), np.int32), dtype=wp.int32, device="cpu")
    wp.Volume.allocate_by_tiles(tiles, voxel_size=0.1, device="cpu").save_to_nvdb(str(path))
    with pytest.raises(InputError, match="no grid 'density' written by weft"):
        nanovdb.read_volume(path)


def test_truncated_files_are_refused(make_grid, tmp_path):
    path = tmp_path / "a.nvdb"
    nanovdb.write_volume(path, FiberVolume({"yarn": make_grid(0, 8)}))
    whole = path.read_bytes()
    for part in (0.0, 0.001, 0.3, 0.7, 0.999):
        path.write_bytes(whole[: int(len(whole) * part)])
        with pytest.raises(InputError):
            nanovdb.read_volume(path)


def test_flipped_bytes_are_found_or_harmless(make_grid, tmp_path):
    path = tmp_path / "a.nvdb"
    volume = FiberVolume({"yarn": make_grid(0, 4)})
    nanovdb.write_volume(path, volume)
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    blind = whole.index(b'{"schema_version"')
    places = [
        *rng.integers(0, 16 + 2 * 176 + 18, 60),
        *rng.integers(16 + 2 * 176 + 18, 2000, 60),
        *rng.integers(blind - 288, blind + 350, 60),
        *rng.integers(0, len(whole), 60),
    ]
    messages = []
    for place in places:
        mutant = bytearray(whole)
        mutant[place] ^= 1 << rng.integers(8)
        path.write_bytes(mutant)
        try:
            assert nanovdb.read_volume(path).content_sha256 == volume.content_sha256
        except InputError as error:
            messages.append(str(error))
    assert len(messages) > 60
    assert not [message for message in messages if "\n" in message]


def test_a_changed_voxel_is_found(make_grid, tmp_path):
    path = tmp_path / "a.nvdb"
    grid = make_grid(0, 4)
    nanovdb.write_volume(path, FiberVolume({"yarn": grid}))
    content = path.read_bytes()
    value = grid.density[grid.density > 0][7].tobytes()
    path.write_bytes(content.replace(value, (np.frombuffer(value, np.float32) * 1.001).tobytes(), 1))
    with pytest.raises(InputError, match="content_sha256"):
        nanovdb.read_volume(path)
    nanovdb.read_volume(path, verify=False)


def test_a_failed_write_leaves_the_earlier_file(make_grid, tmp_path, monkeypatch):
    path = tmp_path / "a.nvdb"
    nanovdb.write_volume(path, FiberVolume({"yarn": make_grid(0, 4)}))
    before = path.read_bytes()
    monkeypatch.setattr(nanovdb, "_grid_hashes", lambda path: [])
    with pytest.raises(RuntimeError, match="differs from what was written"):
        nanovdb.write_volume(path, FiberVolume({"yarn": make_grid(1, 4)}))
    assert path.read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.nvdb"]
