"""How fast fibers are made: points per second of one thread, and what a second thread adds."""

from __future__ import annotations

import threading
import time
import tomllib

import numpy as np
import pytest
import warp as wp

from weft.fiber_model.config import FibersConfig
from weft.fiber_model.fibers import FiberSet, run
from weft.fiber_model.strand_kernels import length_kernel
from weft.fiber_model.yarns.yarns import YarnSet

pytestmark = pytest.mark.benchmark


def _loop_of_yarn(preset: str, pytestconfig: pytest.Config) -> FiberSet:
    """A ring of 38 cm of yarn of radius 1 mm."""
    path = pytestconfig.rootpath / "configs" / "presets" / "fibers" / f"{preset}.toml"
    t = np.arange(32) * 2 * np.pi / 32
    points = 60.0 * np.stack([np.cos(t), np.sin(t), 0.3 * np.sin(2 * t)], axis=1)
    yarns = YarnSet(points, np.array([0, 32]), np.array([True]), np.ones(1), np.zeros(1, np.int32))
    return run(FibersConfig(**tomllib.loads(path.read_text(encoding="utf-8"))), yarns)


def _make_all(fiber_set: FiberSet) -> float:
    """Make every point once, to sum up the fibers' length; seconds of this thread's processor time."""
    length = wp.empty((fiber_set.stretch_count, 2), dtype=wp.float64, device="cpu")
    tables = fiber_set.tables("cpu")
    begin = time.thread_time()
    wp.launch(length_kernel, fiber_set.stretch_count, inputs=[tables, length], device="cpu")
    return time.thread_time() - begin


@pytest.mark.parametrize("preset", ["cotton2", "rayon1", "polyester1"])
def test_points_per_second_of_one_thread(preset: str, pytestconfig: pytest.Config) -> None:
    fiber_set = _loop_of_yarn(preset, pytestconfig)
    points = fiber_set.stretch_point_counts().sum() / 1e6
    _make_all(fiber_set)
    seconds = min(_make_all(fiber_set) for _ in range(5))
    print(f"\n{preset}: {points:.1f} M points of fibers in {seconds:.3f} CPU s: {points / seconds:.0f} M/s")


def test_two_threads_against_one(pytestconfig: pytest.Config) -> None:
    """Launches release Python's lock; on two idle cores the ratio is near 2."""
    fiber_set = _loop_of_yarn("cotton2", pytestconfig)
    _make_all(fiber_set)
    ratios = []
    for _ in range(5):
        begin = time.perf_counter()
        _make_all(fiber_set)
        one = time.perf_counter() - begin
        threads = [threading.Thread(target=_make_all, args=(fiber_set,)) for _ in range(2)]
        begin = time.perf_counter()
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        ratios.append(2 * one / (time.perf_counter() - begin))
    print(f"\ntwo threads make {np.median(ratios):.2f} times the points of one (best {max(ratios):.2f})")
