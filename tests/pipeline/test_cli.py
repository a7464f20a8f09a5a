"""The command line as a user meets it: one clear line for a mistake, the promised exit codes, light start."""

from __future__ import annotations

import errno
import json
import os
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from weft.files.errors import DeviceMemoryError
from weft.pipeline import cli
from weft.pipeline.cli import exit_code
from weft.pipeline.stages import CHAIN

CHECKOUT = Path(__file__).resolve().parents[2]
EXAMPLES = CHECKOUT / "configs" / "examples"

KNIT = """\
[yarns]
kind = "knit"
size_mm = [15, 12]
stitch_width_mm = 7.5
[fibers]
preset = "cotton2"
[voxelize]
voxel_size_mm = 0.2
[scattering]
preset = "reference"
[render]
resolution = [16, 16]
samples_per_pixel = 1
"""


def weft(*arguments, cwd=None):
    """A run of the real command in a process of its own."""
    command = [sys.executable, "-m", "weft.pipeline.cli", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, timeout=120, check=False)


def job(tmp_path, text):
    path = tmp_path / "job.toml"
    path.write_text(text)
    return path


def bcc(path, curves):
    """A .bcc file of open Catmull-Rom curves."""
    counts = [len(curve) for curve in curves]
    header = struct.pack("<3sB2sBBQQ40s", b"BCC", 0x44, b"C0", 3, 1, len(curves), sum(counts), b"")
    body = b"".join(struct.pack("<i", len(curve)) + np.asarray(curve, "<f4").tobytes() for curve in curves)
    path.write_bytes(header + body)
    return path


STRAIGHT = np.stack([np.linspace(0, 10, 8), np.zeros(8), np.zeros(8)], axis=1)
PYP = "*pattern\n0.01 0.01 0.001 4\n*Q\n" + "".join(f"{0.0025 * i} 0 0 0\n" for i in range(4))
PYP += "*E\n0 1 0 0\n1 2 0 0\n2 3 0 0\n3 0 1 0\n"


def bcc_job(tmp_path, curves, *, cut=None):
    data = bcc(tmp_path / "yarns.bcc", curves).read_bytes()
    (tmp_path / "yarns.bcc").write_bytes(data[:cut])
    yarns = '[yarns]\nkind = "file"\nfile = "yarns.bcc"\nscale_to_mm = 1.0\nradius_mm = 0.5\n'
    return job(tmp_path, yarns)


def unknown_key(tmp_path):
    return job(
        tmp_path, KNIT + "sampels_per_pixel = 3\n"
    ), "job.toml:14: render.sampels_per_pixel: unknown key"


def missing_file(tmp_path):
    return job(
        tmp_path, '[yarns]\nkind = "tile"\ntile = "no.pyp"\nsize_mm = [1, 1]\n'
    ), "job.toml:3: yarns.tile: file"


def truncated_bcc(tmp_path):
    return bcc_job(tmp_path, [STRAIGHT], cut=-5), "truncated"


def truncated_bcc_header(tmp_path):
    return bcc_job(tmp_path, [STRAIGHT], cut=20), "within its 64-byte header"


def truncated_pyp(tmp_path):
    (tmp_path / "a.pyp").write_text(PYP[:-20])
    return job(tmp_path, '[yarns]\nkind = "tile"\ntile = "a.pyp"\nsize_mm = [30, 30]\n'), "a.pyp"


def one_point(tmp_path):
    return bcc_job(
        tmp_path, [STRAIGHT, STRAIGHT[:1]]
    ), "yarn 1 has 1 control point; a centerline needs at least"


def nan_coordinates(tmp_path):
    broken = STRAIGHT.copy()
    broken[3, 1] = np.nan
    return bcc_job(tmp_path, [STRAIGHT, broken]), "finite"


def too_much_memory(tmp_path):
    text = KNIT.replace("voxel_size_mm = 0.2", "voxel_size_mm = 0.0002")
    return job(tmp_path, text), "set voxelize.voxel_size_mm to"


BAD_INPUTS = [
    unknown_key,
    missing_file,
    truncated_bcc,
    truncated_bcc_header,
    truncated_pyp,
    one_point,
    nan_coordinates,
    too_much_memory,
]


def artifacts(folder):
    """Everything but the sources and the yarns that a later stage was refused for."""
    made = {file.name for file in folder.rglob("*") if file.is_file()}
    return made - {"job.toml", "yarns.bcc", "a.pyp", "yarns.npz", "yarns.run.json"}


@pytest.mark.parametrize("bad_input", BAD_INPUTS, ids=lambda case: case.__name__)
@pytest.mark.parametrize("command", ["run", "check"])
def test_bad_input_is_one_line_and_exit_code_2_and_nothing_half_written(tmp_path, capfd, bad_input, command):
    path, expected = bad_input(tmp_path)
    assert exit_code([command, str(path)]) == 2
    output = capfd.readouterr().err.splitlines()
    (line,) = [line for line in output if not line.startswith(("yarns:", "voxelize: "))]
    assert expected in line
    assert artifacts(tmp_path) == set()


@pytest.mark.parametrize("bad_input", [unknown_key, truncated_bcc, one_point], ids=lambda case: case.__name__)
def test_bad_input_through_the_real_command(tmp_path, bad_input):
    path, expected = bad_input(tmp_path)
    done = weft("run", path)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert expected in done.stderr.splitlines()[-1]
    assert done.stdout == ""


def test_a_key_that_a_stage_refuses_is_placed_in_the_file(tmp_path, capsys):
    path = job(tmp_path, '[yarns]\nkind = "weave"\nsize_mm = [5, 5]\nweft_per_cm = 200.0\n')
    assert exit_code(["yarns", str(path)]) == 2
    assert f"{path}:4: yarns.weft_per_cm: " in capsys.readouterr().err


def test_usage_mistakes_are_one_line_and_exit_code_2(capsys):
    for arguments in (["rnu"], ["run"], ["run", "a.toml", "--frce"], ["--frob"]):
        assert exit_code(arguments) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith("weft: ")


def too_large_an_array():
    try:
        return np.empty((2**25, 2**27), np.float64)  # more than any machine can address
    except MemoryError as error:
        return error


@pytest.mark.parametrize(
    ("error", "code", "message"),
    [
        (DeviceMemoryError("the grid needs 3.1 GiB but the device offers 2.0 GiB"), 4, "3.1 GiB"),
        (MemoryError(), 4, "this needs more memory than this machine has; "),
        (too_large_an_array(), 4, "this needs 36028797018963968 bytes more of memory; "),
        (OSError(errno.ENOSPC, "No space left on device", "volume.vdb"), 5, "volume.vdb: no space left"),
        (KeyboardInterrupt(), 130, "weft: interrupted"),
    ],
)
def test_exit_codes(monkeypatch, capsys, error, code, message):
    def fail():
        raise error

    monkeypatch.setattr(cli, "_command", lambda arguments: fail)
    assert exit_code(["run", "x.toml"]) == code
    assert message in capsys.readouterr().err


def test_our_own_mistakes_stay_tracebacks(monkeypatch):
    def fail():
        raise ZeroDivisionError

    monkeypatch.setattr(cli, "_command", lambda arguments: fail)
    with pytest.raises(ZeroDivisionError):
        exit_code(["run", "x.toml"])


SLEEP = """
import signal, sys, time
from weft.pipeline import cli
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs are born ignoring it
def sleep():
    print("working", flush=True)
    time.sleep(60)
cli._command = lambda arguments: sleep
cli.main([])
"""


@pytest.mark.parametrize(("sent", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_signals_end_with_their_codes_and_no_traceback(sent, code):
    process = subprocess.Popen(
        [sys.executable, "-c", SLEEP], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "working\n"
    process.send_signal(sent)
    _, complaint = process.communicate(timeout=10)
    assert process.returncode == code
    assert len(complaint.splitlines()) == 1


HEAVY = ("warp", "jax", "moderngl", "vtk", "pyvista", "scipy", "numpy", "pydantic", "OpenEXR")


def modules_after(code):
    script = f"{code}\nimport sys, json\nprint(json.dumps(sorted(sys.modules)))"
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=120
    )
    return set(json.loads(done.stdout.splitlines()[-1]))


def test_help_loads_nothing_heavy():
    loaded = modules_after("from weft.pipeline.cli import exit_code; exit_code(['--help'])")
    assert not loaded & set(HEAVY)


def test_the_renderer_starts_without_scipy():
    assert "scipy" not in modules_after("import weft.renderer.render, weft.renderer.exposure")


def test_help_answers_quickly():
    weft("--help")
    began = time.perf_counter()
    assert weft("--help").returncode == 0
    # promised: half a second; the margin is for a busy machine
    assert time.perf_counter() - began < 2.0


def test_reading_a_job_loads_nothing_heavy():
    loaded = modules_after(
        "from pathlib import Path; from weft.pipeline.config import load; "
        f"load(Path({str(EXAMPLES / 'twill.toml')!r}))"
    )
    assert not loaded & {"warp", "jax", "moderngl", "vtk", "pyvista", "scipy", "OpenEXR"}


@pytest.mark.parametrize(
    ("stage", "modules"),
    [
        ("yarns", "fiber_model.yarns.build, weft.fiber_model.yarns.yarn_file"),
        ("voxelize", "voxelize.voxelize, weft.fiber_model.fibers, weft.voxelize.vdb, weft.voxelize.nanovdb"),
        ("scattering", "fiber_model.scattering.config"),
        ("render", "renderer.render, weft.voxelize.vdb, weft.voxelize.nanovdb"),
    ],
)
def test_the_key_of_a_stage_covers_the_code_that_it_loads(stage, modules):
    """Or a change of that code would leave old results standing as fresh."""
    loaded = modules_after(f"import weft.{modules}")
    rooms = ("weft.fiber_model.", "weft.voxelize.", "weft.renderer.")
    files = [name.removeprefix("weft.").replace(".", "/") for name in loaded if name.startswith(rooms)]
    code = [part.removesuffix(".py") for part in CHAIN[stage].code]
    missing = [
        file
        for file in files
        if (CHECKOUT / f"{file}.py").exists()
        and not any(file == part or file.startswith(f"{part}/") for part in code)
    ]
    assert missing == []


@pytest.mark.gl
def test_the_whole_chain_runs_and_rendering_loads_no_jax(tmp_path):
    path = job(tmp_path, KNIT)
    first = weft("run", path)
    assert first.returncode == 0, first.stderr
    folder = tmp_path / "job.out"
    names = ["image.exr", "image.png", "scattering.json", "volume.vdb", "yarns.npz"]
    records = ["image.run.json", "scattering.run.json", "volume.run.json", "yarns.run.json"]
    assert sorted(os.listdir(folder)) == sorted(names + records)
    before = {name: (folder / name).read_bytes() for name in names}

    again = weft("run", path, "--force", cwd="/")
    assert again.returncode == 0, again.stderr
    assert {name for name in names if (folder / name).read_bytes() != before[name]} == set()

    loaded = modules_after(
        "from weft.pipeline.cli import exit_code; "
        f"assert exit_code(['render', {str(path)!r}, '--force']) == 0"
    )
    assert "moderngl" in loaded
    assert not loaded & {"jax", "warp", "pyvista", "vtk"}

    third = weft("run", path, "--progress", "json")
    events = [json.loads(line) for line in third.stdout.splitlines()]
    assert [event["text"] for event in events] == [
        f"{stage}: fresh" for stage in ("yarns", "voxelize", "scattering", "render")
    ]


def test_schema_is_json_and_knows_every_table(capsys):
    assert exit_code(["schema"]) == 0
    schema = json.loads(capsys.readouterr().out)
    assert {"include", "yarns", "fibers", "voxelize", "scattering", "render", "output"} <= set(
        schema["properties"]
    )
    assert "required" not in schema["$defs"]["FibersConfig"]


@pytest.mark.parametrize("example", sorted(EXAMPLES.glob("*.toml")), ids=lambda path: path.stem)
def test_examples_are_valid(example, tmp_path, capsys):
    assert exit_code(["check", str(example), "--output", str(tmp_path)]) == 0
    assert "no mistakes found" in capsys.readouterr().out


def test_the_job_on_real_input_is_valid(shared_data, tmp_path, capsys):
    path = CHECKOUT / "tests" / "jobs" / "stockinette_tile.toml"
    assert exit_code(["check", str(path), "--output", str(tmp_path)]) == 0
    assert "1024 x 512" in capsys.readouterr().out
