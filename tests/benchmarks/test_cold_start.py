"""From the command to the first picture: a process starts, compiles its shaders, and draws one sample."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time

import pytest

from tests.pipeline.test_cli import KNIT

ROUNDS = 3


def render(job, cache):
    """Wall and CPU seconds of `weft render`, from the start of the process to its end."""
    command = [sys.executable, "-m", "weft.pipeline.cli", "render", str(job), "--force"]
    environment = os.environ | {"MESA_SHADER_CACHE_DIR": str(cache)}
    before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(command, check=True, capture_output=True, env=environment)
    wall, after = time.perf_counter() - started, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


@pytest.mark.benchmark
def test_cold_start_to_first_picture(tmp_path):
    job = tmp_path / "job.toml"
    job.write_text(KNIT.replace("[16, 16]", "[64, 64]"))
    subprocess.run([sys.executable, "-m", "weft.pipeline.cli", "run", str(job)], check=True)
    empty = [render(job, tmp_path / f"cache{i}") for i in range(ROUNDS)]
    warm = [render(job, tmp_path / "cache0") for _ in range(ROUNDS)]
    help_only = time.perf_counter()
    subprocess.run([sys.executable, "-m", "weft.pipeline.cli", "--help"], check=True, capture_output=True)
    help_only = time.perf_counter() - help_only
    for name, times in (("empty shader cache", empty), ("warm", warm)):
        wall, cpu = (min(column) for column in zip(*times, strict=True))
        print(f"\ncommand to picture, {name}: {wall:.2f} s, {cpu:.2f} CPU s (best of {ROUNDS})")
    print(f"weft --help: {help_only:.2f} s; load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
