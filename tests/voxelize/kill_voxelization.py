"""Kill a voxelization at random moments and let it resume: `kill_voxelization.py FOLDER KILLS SEED`.

Each run is a fork of this process, so that it begins with its first tile rather than with imports. Prints one
line of JSON: how many runs were killed, how many with finished tiles on the disk, how many ended otherwise.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import sys
import time
from pathlib import Path

import numpy as np

from weft.voxelize.accumulator import load_kernels
from weft.voxelize.config import VoxelizeConfig
from weft.voxelize.sources import SegmentSource
from weft.voxelize.stream import parts_folder, stream_source

CONFIG = VoxelizeConfig(voxel_size_mm=0.02, tile_voxels=32)


def fibers() -> SegmentSource:
    """Wandering fibers in a dozen tiles."""
    rng = np.random.default_rng(0)
    steps = rng.normal(size=(2000, 60, 3)) * 0.02
    points = rng.uniform(-0.7, 0.7, (2000, 1, 3)) + np.cumsum(steps, axis=1)
    segments = np.stack([points[:, :-1], points[:, 1:]], axis=2).reshape(-1, 2, 3)
    return SegmentSource(segments.astype(np.float32), fiber_radius_mm=0.005)


def start(source: SegmentSource, path: Path) -> int:
    """The process id of a run."""
    child = os.fork()
    if child == 0:
        try:
            stream_source(CONFIG, source, [path], worker_count=2)
        except BaseException:
            os._exit(1)
        os._exit(0)
    return child


def finish(source: SegmentSource, path: Path) -> float:
    """Run to the end; the seconds it took."""
    began = time.monotonic()
    _, status = os.waitpid(start(source, path), 0)
    if status != 0:
        sys.exit(f"a run that was not killed ended with status {status}")
    return time.monotonic() - began


def main(folder: Path, kills: int, seed: int) -> None:
    load_kernels()
    source, rng = fibers(), random.Random(seed)
    whole = folder / "whole.vdb"
    seconds = finish(source, whole)
    outcome = {"kills": 0, "with_parts": 0, "different": 0, "seconds": seconds}
    while outcome["kills"] < kills:
        path = folder / "killed.vdb"
        path.unlink(missing_ok=True)
        shutil.rmtree(parts_folder(path), ignore_errors=True)
        child = start(source, path)
        time.sleep(rng.uniform(0, seconds))
        os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
        if not os.WIFSIGNALED(status):
            continue  # it was done before
        outcome["kills"] += 1
        outcome["with_parts"] += any(parts_folder(path).glob("tile_*.part"))
        finish(source, path)
        outcome["different"] += path.read_bytes() != whole.read_bytes() or parts_folder(path).exists()
    print(json.dumps(outcome))


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
