"""How fast fibers are made: points per second of one core and of all, against numpy in the same run."""

from __future__ import annotations

import json
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable

import numpy as np
import pytest

from tests.peers.numpy_fibers import stretch_points
from tests.peers.plain_numpy_fibers import PlainFibers
from weft.fiber_model.config import FibersConfig
from weft.fiber_model.fiber_arrays import plan_yarn
from weft.fiber_model.fiber_curves import strand_points
from weft.fiber_model.fibers import FiberSet, run
from weft.fiber_model.flyaways import FlyawayShape
from weft.fiber_model.split_launch import cpu_threads
from weft.fiber_model.yarns.yarns import YarnSet

pytestmark = pytest.mark.benchmark
ROUNDS = 5
NUMPY_STRETCHES = 12
"""Of 119: numpy is slow."""


def _loop_of_yarn(preset: str, pytestconfig: pytest.Config) -> tuple[FiberSet, FlyawayShape]:
    """A ring of 38 cm of yarn of radius 1 mm."""
    path = pytestconfig.rootpath / "configs" / "presets" / "fibers" / f"{preset}.toml"
    config = FibersConfig(**tomllib.loads(path.read_text(encoding="utf-8")))
    t = np.arange(32) * 2 * np.pi / 32
    points = 60.0 * np.stack([np.cos(t), np.sin(t), 0.3 * np.sin(2 * t)], axis=1)
    fibers = run(
        config, YarnSet(points, np.array([0, 32]), np.array([True]), np.ones(1), np.zeros(1, np.int32))
    )
    yarn = fibers.yarns[0]
    length, intervals = fibers.report.yarn_length_mm, int(yarn["intervals"])
    return fibers, plan_yarn(config, 1.0, length, intervals, closed=True).flyaways


def _seconds(work: Callable[[], object]) -> float:
    begin = time.perf_counter()
    work()
    return time.perf_counter() - begin


@pytest.mark.parametrize("preset", ["cotton2", "rayon1", "polyester1"])
def test_points_per_second_against_numpy(preset: str, pytestconfig: pytest.Config) -> None:
    fibers, shape = _loop_of_yarn(preset, pytestconfig)
    everything = np.arange(fibers.stretch_count)
    some = everything[:: fibers.stretch_count // NUMPY_STRETCHES]
    plain = PlainFibers(fibers, shape)
    peers = {
        "numpy, float64": plain.stretch_points,
        "numpy tuned, float32": lambda stretch: stretch_points(fibers, stretch, shape),
    }
    ours = strand_points(fibers, some)
    for peer in peers.values():
        theirs = np.concatenate([peer(int(stretch)) for stretch in some])
        assert np.abs(ours.points - theirs).max() < 5e-5  # at 60 mm the spacing of float32 is 4e-6
    millions, some_millions = fibers.stretch_point_counts().sum() / 1e6, len(ours.points) / 1e6
    threads = {"one thread": 1, f"{cpu_threads()} threads": cpu_threads()}
    rates: dict[str, list[float]] = {name: [] for name in [*peers, *threads]}
    for _ in range(ROUNDS):  # interleaved, so that other load on the machine hits all of them
        for name, peer in peers.items():
            rates[name].append(some_millions / _seconds(lambda peer=peer: [peer(int(i)) for i in some]))
        for name, count in threads.items():
            made = _seconds(lambda count=count: strand_points(fibers, everything, threads=count))
            rates[name].append(millions / made)
    print(f"\n{preset}, medians of {ROUNDS} rounds, M points/s:")
    for name, found in rates.items():
        ratios = [f"{np.median(np.array(found) / rates[peer]):.1f} x {peer}" for peer in peers]
        print(f"  {name}: {np.median(found):.1f}" + f" ({', '.join(ratios)})" * (name in threads))


def test_points_summed_to_lengths(pytestconfig: pytest.Config) -> None:
    """Without writing points to memory: what a voxelizer sees."""
    fibers, _ = _loop_of_yarn("cotton2", pytestconfig)
    millions = fibers.stretch_point_counts().sum() / 1e6
    fibers.fiber_lengths_mm()
    one, both = (
        [_seconds(lambda threads=threads: fibers.fiber_lengths_mm(threads=threads)) for _ in range(ROUNDS)]
        for threads in (1, cpu_threads())
    )
    print(
        f"\ncotton2, summed to lengths: one thread {millions / np.median(one):.0f} M/s, "
        f"{cpu_threads()} threads {millions / np.median(both):.0f} M/s"
    )


def test_a_sweater_before_the_first_voxel(pytestconfig: pytest.Config) -> None:
    """600 m of stockinette of radius 1 mm: from yarns in memory to tables and the box of every stretch."""
    root = pytestconfig.rootpath
    preset = root / "configs" / "presets" / "fibers" / "cotton2.toml"
    command = [sys.executable, str(root / "tests" / "benchmarks" / "sweater.py"), str(preset), "903"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300)
    found = json.loads(done.stdout.splitlines()[-1])
    print(
        f"\n{found['meters']:.0f} m of yarn, {found['nodes'] / 1e6:.1f} M nodes, {found['hairs'] / 1e6:.1f} "
        f"M hairs: {found['seconds']:.1f} s ({found['run_s']:.1f} s of them `run`), "
        f"{found['cpu_seconds']:.1f} CPU s; {found['peak_mb']:.0f} MB resident at most, "
        f"{found['loaded_mb']:.0f} MB before"
    )
