"""How fast segments become voxels, against plain C++ and numpy; and .vdb files, against voxel-wise access."""

from __future__ import annotations

import shutil
import subprocess
import time
import tomllib
from pathlib import Path

import numpy as np
import pytest

from weft.fiber_model.config import FibersConfig
from weft.fiber_model.fibers import FiberSet, run
from weft.fiber_model.yarns.fabrics.knit import knit_yarns
from weft.voxelize import sources, vdb
from weft.voxelize.accumulator import TileAccumulator
from weft.voxelize.config import VoxelizeConfig
from weft.voxelize.fill import fill_tiles
from weft.voxelize.grid import FiberVolume
from weft.voxelize.openvdb_library import extension
from weft.voxelize.parts import PartFolder
from weft.voxelize.plan import checked_region, plan_tiles
from weft.voxelize.sources import FiberSource, SegmentSource
from weft.voxelize.stream import finish_tiles
from weft.voxelize.tiles import TileWork, snap_region
from weft.voxelize.voxelize import voxelize_segments

pytestmark = pytest.mark.benchmark

VOXEL, SIDE, RADIUS = 0.05, 128, 0.008
SYSTEM_PYTHON = "/usr/bin/python3"


@pytest.fixture(scope="module")
def segments() -> np.ndarray:
    """A million segments of 0.1 mm, as fibers of 6 mm, in a cube of 6.4 mm."""
    rng = np.random.default_rng(0)
    axis = rng.normal(size=(16000, 60, 3)) * 0.15 + rng.normal(size=(16000, 1, 3))
    axis /= np.linalg.norm(axis, axis=2, keepdims=True)
    points = np.cumsum(0.1 * axis, axis=1)
    points += rng.uniform(0, 6.4, (16000, 1, 3)) - points.mean(axis=1, keepdims=True)
    pairs = np.stack([points[:, :-1], points[:, 1:]], axis=2).reshape(-1, 2, 3).astype(np.float32)
    return pairs[((pairs > 0.2) & (pairs < 6.2)).all(axis=(1, 2))]


def plain_cpp(segments: np.ndarray, folder: Path) -> tuple[float, float]:
    """Processor seconds, and the length that it found."""
    compiler = shutil.which("c++")
    if compiler is None:
        pytest.skip("no C++ compiler")
    segments.tofile(folder / "segments")
    source = Path(__file__).with_name("dense_voxels.cpp")
    subprocess.run([compiler, "-O3", "-o", str(folder / "dense"), str(source)], check=True)
    command = [str(folder / "dense"), str(folder / "segments"), str(VOXEL), str(SIDE), "5"]
    answer = subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()
    return float(answer[0]), float(answer[1])


def one_tile(segments: np.ndarray, *, native: bool) -> float:
    """Processor seconds of this thread to add all segments to one tile."""
    source, region = SegmentSource(segments, fiber_radius_mm=RADIUS), snap_region(None, VOXEL)
    items = np.arange(len(source.cost))
    work = TileWork(np.zeros(3, np.int64), items, np.zeros(len(items), bool))
    accumulator = TileAccumulator(SIDE, VOXEL, native=native)
    best = np.inf
    for _ in range(5):
        tile = accumulator.open(np.zeros(3, np.int64), region, np.zeros((1, 2), np.float32))
        begin = time.thread_time()
        source.accumulate(tile, work)
        best = min(best, time.thread_time() - begin)
        accumulator.resolve(np.zeros(3, np.int64), RADIUS)
    return float(best)


def in_numpy(segments: np.ndarray) -> float:
    """Processor seconds of the same clipping, vectorized: crossings of a segment sorted, pieces binned."""
    begin = time.process_time()
    p, q = segments[:, 0] / VOXEL, segments[:, 1] / VOXEL
    d = q - p
    low, high = np.floor(np.minimum(p, q)), np.floor(np.maximum(p, q))
    most = int((high - low).max())
    faces = low[:, :, None] + 1 + np.arange(most)
    u = np.where(faces <= high[:, :, None], (faces - p[:, :, None]) / d[:, :, None], 1.0)
    u = np.sort(np.clip(u.reshape(len(p), -1), 0, 1), axis=1)
    u = np.concatenate([np.zeros((len(p), 1)), u, np.ones((len(p), 1))], axis=1)
    middle = p[:, None] + d[:, None] * (0.5 * (u[:, 1:] + u[:, :-1]))[:, :, None]
    cell = np.floor(middle).astype(np.int64) @ np.array([SIDE * SIDE, SIDE, 1])
    length = np.linalg.norm(d, axis=1)
    piece = (u[:, 1:] - u[:, :-1]) * length[:, None]
    t = d / length[:, None]
    for moment in (
        np.ones(len(t)),
        *(t[:, i] * t[:, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))),
    ):
        np.bincount(cell.ravel(), weights=(piece * moment[:, None]).ravel(), minlength=SIDE**3)
    return time.process_time() - begin


def test_accumulation_against_plain_cpp_and_numpy(segments, tmp_path):
    peer, length = plain_cpp(segments, tmp_path)
    assert length == pytest.approx(np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1).sum(), rel=1e-3)
    count, numpy_seconds = len(segments) / 1e6, in_numpy(segments[: len(segments) // 10]) * 10
    print(f"\nper core, Msegments/s: plain C++ -O3 {count / peer:.1f}, numpy {count / numpy_seconds:.2f}")
    for name, native in (("C++", True), ("Warp", False)):
        ours = one_tile(segments, native=native)
        print(
            f"  ours, {name}: {count / ours:.1f}; {peer / ours:.2f} times plain C++, "
            f"{numpy_seconds / ours:.0f} times numpy"
        )


def test_fibers_and_accumulation_against_plain_cpp(segments, tmp_path, pytestconfig):
    """Fibers of a knit swatch made, added up and resolved; each segment counted once, however often made."""
    peer, _ = plain_cpp(segments, tmp_path)
    fibers = knit_fibers(pytestconfig, 20.0)
    source, config = FiberSource(fibers), VoxelizeConfig(voxel_size_mm=VOXEL)
    plan = plan_tiles(config, source, checked_region(config, source), config.tile_voxels)
    count = float((fibers.stretch_point_counts() - fibers.stretch_strand_counts()).sum()) / 1e6

    def seconds(resolve: bool) -> float:
        accumulator = TileAccumulator(plan.tile_voxels, VOXEL)
        taken = 0.0
        for job in plan.jobs:
            tile = accumulator.open(job.work.origin, plan.region, plan.lines[0])
            begin = time.thread_time()
            source.accumulate(tile, job.work)
            taken += 0.0 if resolve else time.thread_time() - begin
            accumulator.resolve(job.work.origin, RADIUS)
            taken += time.thread_time() - begin if resolve else 0.0
        return taken

    for name, resolve in (("fibers made and added", False), ("and density and direction besides", True)):
        ours = min(seconds(resolve) for _ in range(3))
        print(
            f"\n{name}: {count / ours:.1f} Msegments/s per core, "
            f"{peer / ours * count / (len(segments) / 1e6):.2f} times the accumulation alone in plain C++"
        )


def knit_fibers(pytestconfig: pytest.Config, side_mm: float) -> FiberSet:
    """Of a square of knit cloth, cotton2 with loops and hairs."""
    path = pytestconfig.rootpath / "configs" / "presets" / "fibers" / "cotton2.toml"
    config = FibersConfig(**tomllib.loads(path.read_text(encoding="utf-8")))
    return run(config, knit_yarns((side_mm, side_mm), stitch_width_mm=2.0))


def test_time_grows_with_fiber_length(pytestconfig):
    """The exponent of seconds against fiber length, over a factor of 64."""
    lengths, times = [], []
    for side in (10.0, 14.1, 20.0, 28.3, 40.0, 56.6, 80.0):
        source = FiberSource(knit_fibers(pytestconfig, side))
        config = VoxelizeConfig(voxel_size_mm=0.1)
        plan = plan_tiles(config, source, checked_region(config, source), config.tile_voxels)
        generated, best = 0, np.inf
        for _ in range(3 if side < 50 else 1):
            begin = time.process_time()
            generated = sum(
                fill_tiles(source, plan, lambda _, batch, length: length, workers=1, progress=None)
            )
            best = min(best, time.process_time() - begin)
        lengths.append(sources.units_to_mm(generated) / 1000)
        times.append(best)
        print(f"\n{lengths[-1]:.1f} m of fiber: {best:.3f} CPU s", end="")
    slope = np.polyfit(np.log(lengths), np.log(times), 1)[0]
    print(f"\nslope over a factor of {lengths[-1] / lengths[0]:.0f}: {slope:.3f}")


def test_two_workers_against_one(pytestconfig, tmp_path):
    """A knit square to finished tiles on the disk, hashes and all."""
    source, config = FiberSource(knit_fibers(pytestconfig, 40.0)), VoxelizeConfig(voxel_size_mm=VOXEL)
    plan = plan_tiles(config, source, checked_region(config, source), config.tile_voxels)

    def seconds(workers: int) -> float:
        folder = PartFolder(tmp_path / "parts", "benchmark")
        begin = time.perf_counter()
        finish_tiles(source, plan, folder, workers, None)
        taken = time.perf_counter() - begin
        folder.remove()
        return taken

    seconds(1)
    ratios = [seconds(1) / seconds(2) for _ in range(5)]
    print(f"\ntwo workers are {np.median(ratios):.2f} times as fast as one (best {max(ratios):.2f})")


ACCESSOR = """
import sys, time
import pyopenvdb as openvdb
import numpy as np
density, direction = openvdb.FloatGrid(), openvdb.Vec3SGrid()
a, b = density.getAccessor(), direction.getAccessor()
places = [tuple(map(int, place)) for place in np.argwhere(np.ones((60, 60, 60)))]
begin = time.perf_counter()
for place in places:
    a.setValueOn(place, 0.5)
    b.setValueOn(place, (0.6, 0.0, 0.8))
density.name, direction.name = "density", "fiber_dir"
openvdb.write(sys.argv[1], [density, direction])
written = time.perf_counter() - begin
grids, _ = openvdb.readAll(sys.argv[1])
begin = time.perf_counter()
a, b = (grid.getConstAccessor() for grid in grids)
for place in places:
    a.getValue(place)
    b.getValue(place)
print(len(places) / written, len(places) / (time.perf_counter() - begin))
"""


def test_vdb_files_against_an_accessor_loop(segments, tmp_path):
    volume = voxelize_segments(VoxelizeConfig(voxel_size_mm=VOXEL), segments, fiber_radius_mm=RADIUS)
    assert isinstance(volume, FiberVolume)
    voxels = volume.brick_count * 512 / 1e6
    path, grids = str(tmp_path / "a.vdb"), list(vdb._leaf_grids(extension(), volume))

    def best(action) -> float:
        times = []
        for _ in range(3):
            begin = time.perf_counter()
            action()
            times.append(time.perf_counter() - begin)
        return voxels / min(times)

    write = best(lambda: extension().write_grids(path, grids))
    read = best(lambda: extension().read_grids(path))
    print(
        f"\n.vdb: {write:.1f} Mvoxel/s of bricks written, {read:.1f} read "
        f"({volume.voxel_count / 1e6 / voxels:.0%} occupied)"
    )
    peer = subprocess.run(
        [SYSTEM_PYTHON, "-c", ACCESSOR, str(tmp_path / "b.vdb")], capture_output=True, text=True, check=False
    )
    if peer.returncode != 0:
        pytest.skip("python3-openvdb is not installed")
    wrote, got = (float(rate) / 1e6 for rate in peer.stdout.split())
    print(
        f"pyopenvdb, voxel by voxel: {wrote:.2f} written, {got:.2f} read: "
        f"we are {write / wrote:.0f} and {read / got:.0f} times as fast"
    )
