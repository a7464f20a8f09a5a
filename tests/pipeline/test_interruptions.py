"""Runs that end early leave a checkpoint and a picture; resumed, they make the bits of a run that did not."""

from __future__ import annotations

import json
import random
import resource
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from weft.pipeline.cli import exit_code
from weft.renderer.checkpoint import read_checkpoint, write_checkpoint
from weft.renderer.image import read_exr

from .test_cli import CHECKOUT, KNIT, job

pytestmark = pytest.mark.gl

SETTINGS = ("--set", "render.resolution=[32,32]", "--set", "render.samples_per_pixel=64")
OFTEN = ("--set", "output.checkpoint_s=0.1")


def command(path, *arguments):
    return [sys.executable, "-m", "weft.pipeline.cli", "render", str(path), *SETTINGS, *arguments]


def start(path, *arguments, **how):
    return subprocess.Popen(
        command(path, *arguments), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **how
    )


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    """A job whose volume is there, and its picture."""
    path = job(tmp_path_factory.mktemp("knit"), KNIT)
    assert exit_code(["run", str(path), *SETTINGS]) == 0
    return path, read_exr(path.parent / "job.out" / "image.exr")[0]


@pytest.fixture
def fresh(rendered):
    """The job without its picture."""
    path, picture = rendered
    for file in (path.parent / "job.out").glob("image*"):
        file.unlink()
    return path, picture, path.parent / "job.out"


def assert_same(file, picture):
    channels, header = read_exr(file)
    assert header["weft.complete"] == 1
    for name, data in picture.items():
        np.testing.assert_array_equal(channels[name], data, err_msg=name)


def wait_for(file, process, seconds=60):
    end = time.monotonic() + seconds
    while not file.is_file() and process.poll() is None and time.monotonic() < end:
        time.sleep(0.02)
    assert file.is_file(), process.communicate()


@pytest.mark.parametrize(("sent", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_leaves_a_checkpoint_and_a_picture(fresh, sent, code):
    path, picture, out = fresh
    process = start(path, *OFTEN, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler))
    wait_for(out / "image.checkpoint.exr", process)
    process.send_signal(sent)
    _, complaint = process.communicate(timeout=60)
    assert process.returncode == code, complaint
    assert "--resume goes on from it" in complaint.splitlines()[-1]
    assert read_checkpoint(out / "image.checkpoint.exr").units is not None
    channels, header = read_exr(out / "image.exr")
    assert header["weft.complete"] == 0
    here = channels["samples"] == 64
    np.testing.assert_array_equal(channels["G"][here], picture["G"][here])
    assert exit_code(["render", str(path), *SETTINGS, "--resume"]) == 0
    assert_same(out / "image.exr", picture)


def waited_for_a_processor(process):
    """Seconds that the main thread of the rendering child could have run and was not let."""
    child = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()[0]
    return int(Path(f"/proc/{child}/schedstat").read_text().split()[1]) / 1e9


def seconds_to_end(process):
    """From now on, without those in which other processes had the processors; and with them."""
    started, first = time.monotonic(), waited_for_a_processor(process)
    last = first
    while process.poll() is None:
        with suppress(OSError, IndexError):  # it has just ended
            last = waited_for_a_processor(process)
        time.sleep(0.01)
    wall = time.monotonic() - started
    return wall - (last - first), wall


SIZES = [
    pytest.param(64, 512, 0, id="small"),
    pytest.param(1024, 4096, 60, id="a million pixels", marks=pytest.mark.proof),
]


@pytest.mark.parametrize(("size", "samples", "checkpoint_s"), SIZES)
def test_sigterm_leaves_a_valid_checkpoint_within_five_seconds(fresh, size, samples, checkpoint_s):
    """And the picture so far. In the process's own time: a busy machine may hold it up for longer."""
    path, _, out = fresh
    more = ["--set", f"render.resolution=[{size},{size}]", "--set", f"output.checkpoint_s={checkpoint_s}"]
    process = start(path, *more, "--set", f"render.samples_per_pixel={samples}")
    wait_for(out / ("image.rendering.png" if checkpoint_s else "image.checkpoint.exr"), process)
    process.send_signal(signal.SIGTERM)
    own, wall = seconds_to_end(process)
    size_mb = (out / "image.checkpoint.exr").stat().st_size / 1e6
    print(f"SIGTERM: {own:.2f} s of its own, {wall:.2f} s by the clock, a checkpoint of {size_mb:.0f} MB")
    assert process.returncode == 143
    assert read_checkpoint(out / "image.checkpoint.exr").begun is not None
    assert own <= 5.0


def wait_for_another(file, before, process, seconds=60):
    """Until the file has another content, or the process ends."""
    end = time.monotonic() + seconds
    while process.poll() is None and time.monotonic() < end:
        if file.is_file() and file.read_bytes() != before:
            return
        time.sleep(0.02)


def kill_and_resume(fresh, kills, seed):
    """Kill the command, most times after it wrote a checkpoint, until it has been started so often."""
    path, picture, out = fresh
    chance = random.Random(seed)
    checkpoint = out / "image.checkpoint.exr"
    survived, advanced, before = 0, 0, b""
    for _ in range(kills):
        process = start(path, *OFTEN, "--resume", "--force")
        try:
            if chance.random() < 0.7:
                wait_for_another(checkpoint, before, process)
                process.communicate(timeout=chance.uniform(0.0, 0.7))
            process.communicate(timeout=chance.uniform(0.0, 2.0))
            survived += 1
            checkpoint.unlink(missing_ok=True)
            before = b""
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
        if checkpoint.is_file():
            read_checkpoint(checkpoint)
            advanced += checkpoint.read_bytes() != before
            before = checkpoint.read_bytes()
    assert exit_code(["render", str(path), *SETTINGS, "--resume", "--force"]) == 0
    assert_same(out / "image.exr", picture)
    return survived, advanced


def test_kill_9_three_times(fresh):
    kill_and_resume(fresh, 3, seed=1)


LONG = ("--set", "render.resolution=[32,32]", "--set", "render.samples_per_pixel=512")
KILLS_PER_ROUND = 25


@pytest.fixture(scope="module")
def long_picture(rendered):
    """The picture with more samples, never interrupted."""
    path, _ = rendered
    assert exit_code(["render", str(path), *LONG]) == 0
    return read_exr(path.parent / "job.out" / "image.exr")[0]


@pytest.mark.proof
@pytest.mark.parametrize("seed", range(8))
def test_kill_9_two_hundred_times(fresh, long_picture, seed):
    """Eight rounds of kills, each then finished; most of them hit a render that has written a checkpoint."""
    path, _, out = fresh
    program = [
        sys.executable,
        "-m",
        "tests.pipeline.kill_renders",
        str(path),
        str(KILLS_PER_ROUND),
        str(seed),
    ]
    done = subprocess.run(
        [*program, *LONG, *OFTEN], cwd=CHECKOUT, capture_output=True, text=True, timeout=900, check=False
    )
    assert done.returncode == 0, done.stderr[-3000:]
    outcome = json.loads(done.stdout.splitlines()[-1])
    print(outcome)
    assert outcome["kills"] == KILLS_PER_ROUND
    assert outcome["with_checkpoint"] > KILLS_PER_ROUND / 2
    assert_same(out / "image.exr", long_picture)


def test_a_full_disk_keeps_the_previous_checkpoint_and_ends_with_5(fresh, monkeypatch, capsys):
    """A checkpoint that hits a limit on the size of files, as on a disk that fills up."""
    path, picture, out = fresh
    checkpoint, soft = out / "image.checkpoint.exr", resource.getrlimit(resource.RLIMIT_FSIZE)
    written = []

    def on_a_disk_that_fills_up(*arguments):
        if len(written) == 3:
            resource.setrlimit(resource.RLIMIT_FSIZE, (len(written[-1]) // 2, soft[1]))
        try:
            write_checkpoint(*arguments)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, soft)
        written.append(checkpoint.read_bytes())

    monkeypatch.setattr("weft.renderer.exposure.write_checkpoint", on_a_disk_that_fills_up)
    assert exit_code(["render", str(path), *SETTINGS, "--set", "output.checkpoint_s=0"]) == 5
    monkeypatch.undo()
    assert "image.checkpoint.exr: no space left on the disk" in capsys.readouterr().err
    assert checkpoint.read_bytes() == written[2]
    assert not list(out.glob(".image*"))
    assert exit_code(["render", str(path), *SETTINGS, "--resume"]) == 0
    assert_same(out / "image.exr", picture)


def test_shares_of_the_command_line_are_merged(fresh, capsys):
    path, picture, out = fresh
    for arguments in (["--blocks", "0:1"], ["--blocks", "1:4", "--tiles", "0:3", "--tile-size", "16"]):
        assert exit_code(["render", str(path), *SETTINGS, *arguments]) == 0
    shares = sorted(str(file) for file in (out / "shares").iterdir())
    merged = str(out / "merged.exr")
    assert exit_code(["merge", *shares, "-o", merged]) == 3
    assert "samples: 16 to 64" in capsys.readouterr().err
    last = ["--blocks", "1:4", "--tiles", "3:4", "--tile-size", "16"]
    assert exit_code(["render", str(path), *SETTINGS, *last]) == 0
    shares = [str(file) for file in (out / "shares").iterdir()]
    assert exit_code(["merge", *shares, "-o", merged]) == 0
    assert_same(merged, picture)
    assert exit_code(["render", str(path), *SETTINGS, "--blocks", "5:9"]) == 2
    assert "the picture has 4 blocks (64 samples in blocks of 16)" in capsys.readouterr().err
