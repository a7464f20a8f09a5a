"""A device that hangs is noticed; the run goes on from its checkpoint, or ends with exit code 4."""

from __future__ import annotations

import subprocess
import sys

import pytest

from .test_interruptions import SETTINGS, assert_same, fresh, rendered  # noqa: F401

HANGING = """
import sys
from pathlib import Path
from weft.pipeline import cli
from weft.renderer import heartbeat
from weft.renderer.gpu import buffers
from weft.renderer.kernel import Kernel

flag, how, run = Path(sys.argv[1]), sys.argv[2], Kernel.advance
heartbeat.HANG_SECONDS = heartbeat.FIRST_SECONDS = 1.0
calls = []

def advance(self):
    calls.append(1)
    resumed = flag.exists()
    hang = len(calls) == (1 if resumed else 6) and (how == "always" or not resumed)
    if hang:
        flag.touch()
        read = buffers.read
        def spin(*arguments):
            while True:
                pass
        buffers.read = spin
    return run(self)

Kernel.advance = advance
cli.main(sys.argv[3:])
"""


def hanging(flag, how, path):
    arguments = [*SETTINGS, "--set", "output.checkpoint_s=0"]
    return subprocess.run(
        [sys.executable, "-c", HANGING, str(flag), how, "render", str(path), *arguments],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


@pytest.mark.gl
def test_a_run_that_hangs_goes_on_from_its_checkpoint(fresh, tmp_path):  # noqa: F811
    path, picture, out = fresh
    done = hanging(tmp_path / "flag", "once", path)
    assert done.returncode == 0, done.stderr
    assert "the device did not finish its work in time; going on from the checkpoint" in done.stderr
    assert_same(out / "image.exr", picture)


@pytest.mark.gl
def test_a_run_that_hangs_again_ends_with_4(fresh, tmp_path):  # noqa: F811
    path, _, out = fresh
    done = hanging(tmp_path / "flag", "always", path)
    assert done.returncode == 4
    assert done.stderr.splitlines()[-1].endswith("did not finish its work in time; giving up")
    assert (out / "image.checkpoint.exr").is_file()
