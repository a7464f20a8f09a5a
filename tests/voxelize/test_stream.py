"""Files written tile by tile: the same bytes as from memory, whatever was killed, short or damaged."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from weft.files.errors import DiskSpaceError, InputError
from weft.voxelize import fill, nanovdb, vdb
from weft.voxelize.config import VoxelizeConfig
from weft.voxelize.memory import resident_bytes
from weft.voxelize.openvdb_library import library_version
from weft.voxelize.stream import parts_folder, voxelize_to_files
from weft.voxelize.voxelize import run

pytestmark = pytest.mark.skipif(library_version() is None, reason="weft was installed without OpenVDB")

CONFIG = VoxelizeConfig(voxel_size_mm=0.06, tile_voxels=32)


@pytest.fixture(scope="module")
def expected(fibers, tmp_path_factory) -> bytes:
    """The file of the volume made in memory."""
    path = tmp_path_factory.mktemp("memory") / "volume.vdb"
    vdb.write_volume(path, run(CONFIG, fibers))
    return path.read_bytes()


@pytest.mark.parametrize(("tile", "workers"), [(16, 3), (32, 1), (128, 2)])
def test_the_file_is_that_of_the_volume_in_memory(fibers, expected, tmp_path, tile, workers):
    path = tmp_path / "volume.vdb"
    config = CONFIG.model_copy(update={"tile_voxels": tile})
    made = voxelize_to_files(config, fibers, [path], worker_count=workers)
    assert path.read_bytes() == expected
    assert [file.name for file in tmp_path.iterdir()] == ["volume.vdb"]
    assert made.content_sha256 == vdb.verify(path)
    assert abs(made.report.relative_difference) < 1e-5
    whole = run(CONFIG, fibers)
    assert (made.brick_count, made.report.voxel_count) == (whole.brick_count, whole.voxel_count)
    assert np.array_equal(made.bounds_mm, whole.bounds_mm)
    assert made.report.generated_length_mm == whole.report.generated_length_mm


def test_nvdb_is_written_from_the_same_tiles(fibers, tmp_path):
    made = voxelize_to_files(CONFIG, fibers, [tmp_path / "a.vdb", tmp_path / "a.nvdb"])
    assert nanovdb.read_volume(tmp_path / "a.nvdb").content_sha256 == made.content_sha256
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.nvdb", "a.vdb"]


def test_progress_rises_to_one_and_names_the_tiles(fibers, tmp_path):
    seen: list[tuple[float, str]] = []
    voxelize_to_files(CONFIG, fibers, [tmp_path / "a.vdb"], progress=lambda *now: seen.append(now))
    fractions = [fraction for fraction, _ in seen]
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    assert "tile 1 of" in seen[0][1]


class Stopped(Exception):
    """In place of whatever ends a run early."""


def stop_after(monkeypatch, tiles: int) -> None:
    """The next runs end when so many tiles have been filled."""
    resolve = fill.TileAccumulator.resolve
    left = [tiles]

    def counted(self, origin, radius):
        if left[0] == 0:
            raise Stopped
        left[0] -= 1
        return resolve(self, origin, radius)

    monkeypatch.setattr(fill.TileAccumulator, "resolve", counted)


def count_tiles(monkeypatch) -> list[int]:
    resolve = fill.TileAccumulator.resolve
    filled = []

    def counted(self, origin, radius):
        filled.append(1)
        return resolve(self, origin, radius)

    monkeypatch.setattr(fill.TileAccumulator, "resolve", counted)
    return filled


def interrupted(monkeypatch, fibers, path: Path, tiles: int) -> int:
    """Run until so many tiles are finished; the number of tiles there are."""
    with monkeypatch.context() as patch:
        stop_after(patch, tiles)
        with pytest.raises(Stopped):
            voxelize_to_files(CONFIG, fibers, [path], worker_count=1)
    assert len(list(parts_folder(path).glob("tile_*.part"))) == tiles
    with monkeypatch.context() as patch:
        filled = count_tiles(patch)
        voxelize_to_files(CONFIG, fibers, [path.with_name("other.vdb")])
        return len(filled)


def test_finished_tiles_are_not_made_again(monkeypatch, fibers, expected, tmp_path):
    path = tmp_path / "volume.vdb"
    total = interrupted(monkeypatch, fibers, path, 3)
    filled = count_tiles(monkeypatch)
    voxelize_to_files(CONFIG, fibers, [path])
    assert len(filled) == total - 3
    assert path.read_bytes() == expected
    assert not parts_folder(path).exists()


def test_damaged_tiles_are_made_again(monkeypatch, fibers, expected, tmp_path):
    path = tmp_path / "volume.vdb"
    total = interrupted(monkeypatch, fibers, path, 4)
    files = sorted(parts_folder(path).iterdir())
    content = bytearray(files[0].read_bytes())
    content[len(content) // 2] ^= 1
    files[0].write_bytes(content)
    files[1].write_bytes(files[1].read_bytes()[:-100])
    files[2].write_bytes(b"")
    filled = count_tiles(monkeypatch)
    voxelize_to_files(CONFIG, fibers, [path])
    assert len(filled) == total - 1
    assert path.read_bytes() == expected


@pytest.mark.parametrize("change", [{"voxel_size_mm": 0.07}, {"region_mm": ((-2, -2, -2), (2, 2, 2))}])
def test_tiles_of_another_job_are_not_taken(monkeypatch, fibers, tmp_path, change):
    path = tmp_path / "volume.vdb"
    interrupted(monkeypatch, fibers, path, 4)
    other = CONFIG.model_copy(update=change)
    made = voxelize_to_files(other, fibers, [path])
    assert made.content_sha256 == run(other, fibers).content_sha256


def test_another_seed_is_another_job(monkeypatch, fibers, tmp_path):
    from dataclasses import replace

    path = tmp_path / "volume.vdb"
    interrupted(monkeypatch, fibers, path, 4)
    other = replace(fibers, config=fibers.config.model_copy(update={"seed": 5}))
    made = voxelize_to_files(CONFIG, other, [path])
    assert made.content_sha256 == run(CONFIG, other).content_sha256


KILLER = Path(__file__).with_name("kill_voxelization.py")


def kill_and_resume(folder: Path, kills: int, seed: int) -> dict:
    command = [sys.executable, str(KILLER), str(folder), str(kills), str(seed)]
    result = subprocess.run(command, capture_output=True, text=True, check=False, timeout=900)
    assert result.returncode == 0, result.stderr
    return json.loads(result.stdout.splitlines()[-1])


def assert_all_resumed(outcome: dict, kills: int) -> None:
    assert outcome["kills"] == kills
    assert outcome["different"] == 0
    # some were hit with tiles finished and the file not yet written
    assert outcome["with_parts"] > 0


def test_kill_9_and_resume_give_the_same_file(tmp_path):
    assert_all_resumed(kill_and_resume(tmp_path, 3, seed=0), 3)


@pytest.mark.proof
def test_kill_9_at_50_random_moments_gives_the_same_file(tmp_path):
    assert_all_resumed(kill_and_resume(tmp_path, 50, seed=1), 50)


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 600 kB; only the superuser may mount one."""
    folder = tmp_path / "disk"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=600k", "none", str(folder)]
    try:
        mounted = subprocess.run(command, capture_output=True, check=False).returncode == 0
    except OSError:
        mounted = False
    if not mounted:
        pytest.skip("a small file system cannot be mounted here (needs the superuser)")
    yield folder
    subprocess.run(["umount", "--lazy", str(folder)], check=True)


def test_a_full_disk_leaves_the_earlier_file(fibers, small_disk):
    path = small_disk / "volume.vdb"
    path.write_bytes(b"the earlier file")
    with pytest.raises(DiskSpaceError, match="no space left") as caught:
        voxelize_to_files(CONFIG, fibers, [path], worker_count=2)
    assert caught.value.exit_code == 5
    assert path.read_bytes() == b"the earlier file"
    assert not list(small_disk.glob(".*"))
    # what is finished is kept, for when there is room
    assert list(parts_folder(path).glob("tile_*.part"))


def test_tiles_and_workers_shrink_to_fit_memory(fibers, expected, tmp_path):
    path = tmp_path / "volume.vdb"
    memory = resident_bytes() / 2**20 + 20
    tight = CONFIG.model_copy(update={"memory_mb": memory, "tile_voxels": 256})
    voxelize_to_files(tight, fibers, [path], worker_count=2)
    assert path.read_bytes() == expected


def test_too_little_memory_is_refused_in_one_line(fibers, tmp_path):
    tight = CONFIG.model_copy(update={"memory_mb": 10.0})
    with pytest.raises(
        InputError, match=r"set voxelize.voxel_size_mm to .* or raise voxelize.memory_mb"
    ) as caught:
        voxelize_to_files(tight, fibers, [tmp_path / "a.vdb"])
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())


MEASURED = """
import sys
from pathlib import Path
import numpy as np
from weft.voxelize.accumulator import load_kernels
from weft.voxelize.config import VoxelizeConfig
from weft.voxelize.sources import SegmentSource
from weft.voxelize.stream import stream_source
rng = np.random.default_rng(0)
start = rng.uniform(-15, 15, (60_000, 3)).astype(np.float32)
segments = np.stack([start, start + rng.normal(size=start.shape).astype(np.float32) * 0.3], axis=1)
load_kernels()
made = stream_source(
    VoxelizeConfig(voxel_size_mm=0.05, memory_mb=float(sys.argv[2])),
    SegmentSource(segments, fiber_radius_mm=0.005), [Path(sys.argv[1])], worker_count=2,
)
peak = next(line for line in open("/proc/self/status") if line.startswith("VmHWM")).split()[1]
print(made.brick_count, int(peak) / 1024)
"""


@pytest.mark.proof
def test_resident_memory_stays_within_bounds(tmp_path):
    """A volume of several times the memory that is allowed."""
    allowed = 600
    command = [sys.executable, "-c", MEASURED, str(tmp_path / "a.vdb"), str(allowed)]
    result = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)
    assert result.returncode == 0, result.stderr
    bricks, peak_mb = map(float, result.stdout.splitlines()[-1].split())
    assert bricks * 8192 / 2**20 > 1.5 * allowed
    assert peak_mb < allowed


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_the_picture_shows_where_the_fibers_are(tmp_path, axis):
    """A letter L of fibers in a thin sheet: its corner is lower left, from whichever side it is seen."""
    from PIL import Image

    from weft.voxelize.sources import SegmentSource
    from weft.voxelize.stream import stream_source

    # right, up and toward the viewer are axes of the world
    right, up, toward = ((2, -1), (1, 1), (0, 1)), ((0, 1), (2, -1), (1, 1)), ((0, 1), (1, 1), (2, 1))
    right, up, toward = (right, up, toward)[axis]
    rng = np.random.default_rng(0)
    points = np.concatenate([rng.uniform((0, 0), (8, 2), (3000, 2)), rng.uniform((0, 0), (2, 8), (3000, 2))])
    segments = np.zeros((len(points), 2, 3), np.float32)
    for (i, sign), values in ((right, points[:, 0]), (up, points[:, 1])):
        segments[:, :, i] = sign * values[:, None]
    segments[:, 1, right[0]] += 0.2
    segments[:, :, toward[0]] = rng.uniform(0, 0.4, (len(points), 1))
    config = VoxelizeConfig(voxel_size_mm=0.1, picture=True)
    stream_source(config, SegmentSource(segments, fiber_radius_mm=0.02), [tmp_path / "a.vdb"])
    pixels = np.asarray(Image.open(tmp_path / "a.png").convert("L"), dtype=float)
    height, width = pixels.shape
    quarters = pixels[height // 2 :, : width // 2], pixels[: height // 2, width // 2 :]
    assert quarters[0].mean() > 2 * quarters[1].mean()
    assert pixels[:10, :10].mean() > 2 * pixels[:10, -10:].mean()
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.png", "a.vdb"]
