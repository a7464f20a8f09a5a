"""Same input, same bits: alone or with the rest, in any order, on any number of threads and processes."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import warp as wp

from weft.fiber_model.fiber_curves import strand_points
from weft.fiber_model.fibers import FiberSet, run
from weft.fiber_model.split_launch import cpu_threads, launch_split
from weft.fiber_model.yarns.yarn_file import save_yarns
from weft.fiber_model.yarns.yarns import YarnSet, concatenate

SCRIPT = Path(__file__).with_name("stretch_bytes.py")
PRESETS = ["cotton1", "silk1", "polyester1"]


@pytest.fixture
def mixed_yarns(straight_yarn, yarn_loop) -> YarnSet:
    """Two open yarns and a closed one, of different radii."""
    return concatenate([straight_yarn(9.0, 0.4), yarn_loop(2.0, 0.3), straight_yarn(7.0, 0.6)])


def _fibers(preset, fiber_config, yarns) -> FiberSet:
    """Few enough loops that bodies, loops and hairs are all among the points."""
    return run(fiber_config(preset, fuzz=0.3, seed=3, fiber_count_scale=0.3), yarns)


@wp.kernel
def _tally(begin: wp.int32, seen: wp.array(dtype=wp.int32)):
    i = begin + wp.tid()
    seen[i] = seen[i] + 1 + i


@pytest.mark.parametrize("count", [1, 2, 15, 16, 17, 1000, 4099])
@pytest.mark.parametrize("threads", [1, 2, 5])
def test_a_split_launch_runs_every_item_once(count, threads) -> None:
    seen = wp.zeros(count, dtype=wp.int32, device="cpu")
    launch_split(_tally, count, [seen], threads=threads)
    assert (seen.numpy() == 1 + np.arange(count)).all()


@pytest.mark.parametrize("preset", PRESETS)
def test_threads_change_no_bit(preset, fiber_config, mixed_yarns) -> None:
    fibers = _fibers(preset, fiber_config, mixed_yarns)
    everything = np.arange(fibers.stretch_count)
    one, two, five = (strand_points(fibers, everything, threads=threads) for threads in (1, 2, 5))
    assert {0, 1, 2} == set(np.unique(one.kind))  # bodies, loops and hairs
    for other in (two, five):
        assert one.points.tobytes() == other.points.tobytes()
        assert one.kind.tobytes() == other.kind.tobytes()
    lengths = [fibers.fiber_lengths_mm(threads=threads).tobytes() for threads in (1, 2, 5)]
    assert lengths[0] == lengths[1] == lengths[2]
    bounds = [fibers.stretch_bounds(threads=threads).tobytes() for threads in (1, 5)]
    assert bounds[0] == bounds[1]


@pytest.mark.parametrize("preset", PRESETS)
def test_every_stretch_alone_has_the_bits_of_the_whole(preset, fiber_config, mixed_yarns) -> None:
    fibers = _fibers(preset, fiber_config, mixed_yarns)
    whole = strand_points(fibers, np.arange(fibers.stretch_count))
    for stretch in np.random.default_rng(5).permutation(fibers.stretch_count):
        part = slice(whole.offsets[stretch], whole.offsets[stretch + 1])
        alone = strand_points(fibers, np.array([stretch]))
        assert alone.points.tobytes() == whole.points[part].tobytes()
        assert alone.kind.tobytes() == whole.kind[part].tobytes()


@pytest.mark.parametrize("preset", PRESETS)
def test_1_2_and_5_processes_make_the_same_bits(preset, fiber_config, mixed_yarns, tmp_path) -> None:
    """Each process starts from the file of yarns and the settings, and makes its share of the stretches."""
    fibers = _fibers(preset, fiber_config, mixed_yarns)
    whole = strand_points(fibers, np.arange(fibers.stretch_count))
    save_yarns(mixed_yarns, tmp_path / "yarns.npz")
    shuffled = np.random.default_rng(7).permutation(fibers.stretch_count)
    for processes in (1, 2, 5):
        shares = np.array_split(shuffled, processes)
        made = _made_apart(fibers, shares, tmp_path)
        assert sum(len(share) for share in shares) == fibers.stretch_count
        for share, archive in zip(shares, made, strict=True):
            for place, stretch in enumerate(share):
                ours = slice(whole.offsets[stretch], whole.offsets[stretch + 1])
                theirs = slice(archive["offsets"][place], archive["offsets"][place + 1])
                assert whole.points[ours].tobytes() == archive["points"][theirs].tobytes()
                assert whole.kind[ours].tobytes() == archive["kind"][theirs].tobytes()


def _made_apart(fibers: FiberSet, shares: list[np.ndarray], folder: Path) -> list[dict[str, np.ndarray]]:
    """What new interpreters make of each share, at most as many at a time as there are cores."""
    commands = []
    for number, share in enumerate(shares):
        job = {
            "config": fibers.config.model_dump(mode="json", exclude={"preset"}),
            "yarns": str(folder / "yarns.npz"),
            "stretches": share.tolist(),
            "threads": 1 + number % 2,
        }
        job_file = folder / f"job_{number}.json"
        job_file.write_text(json.dumps(job), encoding="utf-8")
        out = folder / f"out_{len(shares)}_{number}.npz"
        commands.append(([sys.executable, str(SCRIPT), str(job_file), str(out)], out))
    for begin in range(0, len(commands), cpu_threads()):
        running = [subprocess.Popen(command) for command, _ in commands[begin : begin + cpu_threads()]]
        assert [process.wait(timeout=120) for process in running] == [0] * len(running)
    made = []
    for _, out in commands:
        with np.load(out) as archive:
            made.append({name: archive[name] for name in archive.files})
    return made
