"""From the command to the first pixels and to the picture: a process starts, compiles, and draws one sample.

Where the time goes is measured by processes that do only the first things that the command does.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time

import pytest

from tests.pipeline.test_cli import KNIT

ROUNDS = 5
COLD_ROUNDS = 3
COMMAND = [sys.executable, "-m", "weft.pipeline.cli"]
PARTS = {
    "Python itself": "pass",
    "numpy": "import numpy",
    "pydantic": "import numpy, pydantic; pydantic.BaseModel",
    "modules of the settings": "import weft.pipeline.config",
    "this job's settings": "{load}",
    "modules of the chain and the renderer": "{load}; import weft.pipeline.stages, weft.renderer.render",
    "driver and context": "{load}; import weft.pipeline.stages, weft.renderer.render; "
    "from weft.renderer.gpu.context import shared_context; shared_context()",
}
"""Each with what stands before it."""
LOAD = "from pathlib import Path; from weft.pipeline.config import load; load(Path({job!r}))"
READER = (
    "from pathlib import Path; from weft.voxelize.vdb_child import read_in_child; "
    "read_in_child(Path({volume!r}), with_leaves=True)"
)
READER_ALONE = "import weft.voxelize.vdb_child, pathlib"


def cost(command, environment):
    """Wall and CPU seconds of a command and its children."""
    before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(command, check=True, capture_output=True, env=environment)
    wall, after = time.perf_counter() - started, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def seconds_to_pixels(command, environment):
    """From the start of a command to its word that all pixels have their sample, before they are written."""
    started = time.perf_counter()
    with subprocess.Popen(
        [*command, "--progress", "json"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, env=environment
    ) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if b'"event": "progress"' in line and b'"fraction": 1.0' in line:
                seconds = time.perf_counter() - started
    return seconds


def least(times):
    return tuple(min(column) for column in zip(*times, strict=True))


@pytest.fixture
def environment(tmp_path):
    """As on a user's machine: modules are compiled once, whatever the tests' own environment says."""
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return kept | {"PYTHONPYCACHEPREFIX": str(tmp_path / "compiled"), "PYDANTIC_DISABLE_PLUGINS": "__all__"}


@pytest.mark.benchmark
def test_cold_start_to_first_picture(tmp_path, environment):
    job = tmp_path / "job.toml"
    job.write_text(KNIT.replace("[16, 16]", "[64, 64]"))
    subprocess.run([*COMMAND, "run", str(job)], check=True, env=environment)

    def render(cache, measure=cost):
        shaders = {"MESA_SHADER_CACHE_DIR": str(tmp_path / cache)}
        return measure([*COMMAND, "render", str(job), "--force"], environment | shaders)

    render("cache0")
    rows = {
        "empty shader cache": least(render(f"cache{i}") for i in range(1, COLD_ROUNDS + 1)),
        "warm": least(render("cache0") for _ in range(ROUNDS)),
    }
    first = min(render("cache0", seconds_to_pixels) for _ in range(ROUNDS))
    help_only, _ = least(cost([*COMMAND, "--help"], environment) for _ in range(ROUNDS))
    for name, (wall, cpu) in rows.items():
        print(f"\ncommand to picture, {name}: {wall:.2f} s, {cpu:.2f} CPU s")
    print(f"command to the last of the first pixels, warm: {first:.2f} s")
    print(f"weft --help: {help_only:.2f} s; load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    show_parts(job, environment, rows["warm"])


def show_parts(job, environment, whole):
    def python(code):
        return least(cost([sys.executable, "-c", code], environment) for _ in range(ROUNDS))

    load = LOAD.format(job=str(job))
    before = (0.0, 0.0)
    print("\n| of the warm start | s | CPU s |\n|---|---|---|")
    for name, code in PARTS.items():
        now = python(code.format(load=load))
        print(f"| {name} | {now[0] - before[0]:.3f} | {now[1] - before[1]:.3f} |")
        before = now
    print(
        f"| the rest: stage keys, volume, light table, one sample, files | {whole[0] - before[0]:.3f} | ",
        end="",
    )
    print(f"{whole[1] - before[1]:.3f} |")
    volume = str(job.with_suffix(".out") / "volume.vdb")
    reading = python(READER.format(volume=volume))[1] - python(READER_ALONE)[1]
    print(f"| in it, on another core: the child that reads the volume | | {reading:.3f} |")
