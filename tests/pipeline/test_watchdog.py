"""A device that hangs is noticed; the run goes on from its checkpoint, or ends with exit code 4."""

from __future__ import annotations

import subprocess
import sys

import pytest

from weft.pipeline import watchdog
from weft.renderer import heartbeat

from .test_interruptions import SETTINGS, assert_same, fresh, rendered  # noqa: F401

NOTICED_WITHIN = 2.0
"""Seconds after a dispatch took too long: two looks, and what a busy machine adds to them."""
NOTED_EVERY = 0.1
"""Seconds between two notes of how long it has hung; the last one is that old at most."""
HANGING = """
import sys, time
from pathlib import Path
from weft.pipeline import cli
from weft.renderer import heartbeat
from weft.renderer.gpu import buffers
from weft.renderer.kernel import Kernel

flag, how, kind, seconds = Path(sys.argv[1]), sys.argv[2], sys.argv[3], float(sys.argv[4])
run, calls = Kernel.advance, []
heartbeat.HANG_SECONDS = seconds
heartbeat.FIRST_SECONDS = 60.0

def hang(*arguments, **options):
    \"\"\"For ever; how long, in seconds of the wall and of the processor, is kept.\"\"\"
    wall, cpu, written = time.monotonic(), time.process_time(), 0.0
    while True:
        if kind == "sleeps":
            time.sleep(0.1)
        now = time.monotonic() - wall
        if now > written + 0.1:
            written = now
            with open(flag, "a") as file:
                file.write(f"{now} {time.process_time() - cpu} {heartbeat.dispatch_share()}\\n")

def advance(self):
    calls.append(1)
    resumed = flag.exists()
    if len(calls) == (2 if resumed else 6) and (how == "always" or not resumed):
        buffers.read = hang
    return run(self)

Kernel.advance = advance
cli.main(sys.argv[5:])
"""


def hanging(flag, how, kind, path, *, seconds=1.0):
    arguments = [*SETTINGS, "--set", "output.checkpoint_s=0"]
    return subprocess.run(
        [sys.executable, "-c", HANGING, str(flag), how, kind, str(seconds), "render", str(path), *arguments],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )


def assert_noticed(flag, kind, seconds):
    """By the clock of what it does: it sleeps by the wall's, and spins by its processor's."""
    wall, cpu, share = map(float, flag.read_text().splitlines()[-1].split())
    took = wall if kind == "sleeps" else cpu
    print(f"a device that {kind}: noticed after {wall:.1f} s, {cpu:.1f} s of a processor")
    assert 0.9 * seconds - NOTED_EVERY <= took <= seconds + NOTICED_WITHIN
    return share


@pytest.mark.gl
@pytest.mark.parametrize("kind", ["spins", pytest.param("sleeps", marks=pytest.mark.proof)])
def test_a_run_that_hangs_goes_on_from_its_checkpoint(fresh, tmp_path, kind):  # noqa: F811
    path, picture, out = fresh
    done = hanging(tmp_path / "flag", "once", kind, path)
    assert done.returncode == 0, done.stderr
    assert "the device did not finish its work in time; going on from the checkpoint" in done.stderr
    assert assert_noticed(tmp_path / "flag", kind, 1.0) == 1.0
    assert_same(out / "image.exr", picture)


@pytest.mark.gl
def test_a_run_that_hangs_again_and_again_ends_with_4(fresh, tmp_path):  # noqa: F811
    """With dispatches half, then a quarter as long."""
    path, _, out = fresh
    done = hanging(tmp_path / "flag", "always", "sleeps", path)
    assert done.returncode == 4, done.stderr
    assert done.stderr.count("going on from the checkpoint") == watchdog.ATTEMPTS - 1
    assert done.stderr.splitlines()[-1].endswith("did not finish its work in time; giving up")
    assert assert_noticed(tmp_path / "flag", "sleeps", 1.0) == 0.25
    assert (out / "image.checkpoint.exr").is_file()


@pytest.mark.proof
@pytest.mark.gl
@pytest.mark.parametrize("kind", ["spins", "sleeps"])
def test_a_hang_is_noticed_within_ten_seconds(fresh, tmp_path, kind):  # noqa: F811
    """With the limit that users have."""
    path, picture, out = fresh
    assert heartbeat.HANG_SECONDS + NOTICED_WITHIN <= 10
    done = hanging(tmp_path / "flag", "once", kind, path, seconds=heartbeat.HANG_SECONDS)
    assert done.returncode == 0, done.stderr
    assert_noticed(tmp_path / "flag", kind, heartbeat.HANG_SECONDS)
    assert_same(out / "image.exr", picture)


def test_work_that_a_busy_machine_holds_up_does_not_hang(monkeypatch):
    """It waits for a processor or a disk for a minute, and sleeps a little in between."""
    clock, active = [0.0], [0.0]
    monkeypatch.setattr(watchdog.time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(watchdog, "_active_seconds", lambda child: active[0])
    monkeypatch.setattr(watchdog, "_cpu_seconds", lambda child: 0.05 * active[0])
    monkeypatch.setattr(watchdog, "_waits_for_a_disk", lambda child: clock[0] > 50)
    dispatch = watchdog._begun("+cpu 8", child=0)
    for _ in range(120):
        clock[0] += 0.5
        active[0] += 0.45 if clock[0] < 50 else 0.0
        assert not dispatch.hangs(0)
    monkeypatch.setattr(watchdog, "_waits_for_a_disk", lambda child: False)
    clock[0] += 5.0
    assert dispatch.hangs(0)


def test_waiting_for_a_processor_is_no_sleep(tmp_path, monkeypatch):
    """A child of two threads that ran for 1 and 2 s and waited for 4 and 8 s, one of them now for a disk."""
    for thread, times, state in ((7, "1000000000 4000000000 9", "D"), (8, "2000000000 8000000000 9", "S")):
        folder = tmp_path / "7" / "task" / str(thread)
        folder.mkdir(parents=True)
        (folder / "schedstat").write_text(times)
        (folder / "stat").write_text(f"{thread} (a (b) c) {state} 1 7")
    monkeypatch.setattr(watchdog, "PROC", tmp_path)
    assert watchdog._active_seconds(7) == 15.0
    assert watchdog._waits_for_a_disk(7)
    assert watchdog._active_seconds(9) is None
