"""A picture rendered by a real scheduler and three workers, one of them killed, has the bits of one run."""

from __future__ import annotations

import subprocess
import sys
import time

import numpy as np
import pytest

from weft.pipeline.cli import exit_code
from weft.renderer.image import read_exr

from .test_interruptions import fresh, rendered  # noqa: F401

SETTINGS = ("--set", "render.resolution=[32,32]", "--set", "render.samples_per_pixel=64")


def test_a_scheduler_that_does_not_answer_is_one_line(fresh, capsys, monkeypatch):  # noqa: F811
    pytest.importorskip("distributed")
    monkeypatch.setattr("weft.pipeline.cluster.CONNECT_SECONDS", 1)
    path, _, _ = fresh
    assert exit_code(["render", str(path), "--cluster", "tcp://127.0.0.1:9"]) == 2
    assert "no scheduler answers" in capsys.readouterr().err


@pytest.mark.proof
@pytest.mark.gl
def test_a_worker_killed_in_the_middle_changes_no_bit(fresh, tmp_path):  # noqa: F811
    pytest.importorskip("distributed")
    path, picture, out = fresh
    address = "tcp://127.0.0.1:38786"
    dask = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--port", "38786", "--no-dashboard"]
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-nanny"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": tmp_path}
    processes = [subprocess.Popen([*dask, "--host", "127.0.0.1"], **quiet)]
    try:
        processes += [subprocess.Popen([*worker, "--no-dashboard"], **quiet) for _ in range(3)]
        command = [
            sys.executable,
            "-m",
            "weft.pipeline.cli",
            "render",
            str(path),
            *SETTINGS,
            "--cluster",
            address,
        ]
        render = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        end = time.monotonic() + 120
        while not list((out / "shares").glob("image.b*.exr")) and time.monotonic() < end:
            time.sleep(0.05)
        processes[1].kill()
        _, complaint = render.communicate(timeout=300)
        assert render.returncode == 0, complaint
    finally:
        for process in processes:
            process.kill()
            process.wait()
    channels, _ = read_exr(out / "image.exr")
    for name, data in picture.items():
        np.testing.assert_array_equal(channels[name], data, err_msg=name)
