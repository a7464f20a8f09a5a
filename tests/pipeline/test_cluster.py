"""What is done by a real scheduler and three workers, one of them killed, has the bits of one run."""

from __future__ import annotations

import subprocess
import sys
import time
import types
from contextlib import contextmanager

import numpy as np
import pytest

from weft.files.errors import InputError
from weft.pipeline.cli import exit_code
from weft.pipeline.cluster import ClusterWork, _submit_stages, slurm_cluster
from weft.renderer.image import read_exr

from .test_cli import KNIT, job
from .test_frames import sequence  # noqa: F401
from .test_interruptions import fresh, rendered  # noqa: F401

SETTINGS = ("--set", "render.resolution=[32,32]", "--set", "render.samples_per_pixel=64")


def test_a_scheduler_that_does_not_answer_is_one_line(fresh, capsys, monkeypatch):  # noqa: F811
    pytest.importorskip("distributed")
    monkeypatch.setattr("weft.pipeline.cluster.CONNECT_SECONDS", 1)
    path, _, _ = fresh
    for command in ("render", "run"):
        assert exit_code([command, str(path), "--cluster", "tcp://127.0.0.1:9"]) == 2
        assert "no scheduler answers" in capsys.readouterr().err


class Recorder:
    """A client that only notes what it is given; a unit is its number."""

    def __init__(self):
        self.units = []

    def submit(self, work, command, after, **options):
        self.units.append((command, after))
        assert options == {"pure": False, "retries": 3}
        return len(self.units) - 1


def test_stages_wait_for_each_other_and_parts_of_the_volume_for_the_yarns(tmp_path):
    client, path = Recorder(), job(tmp_path, KNIT)
    work = ClusterWork(path, ("render.seed=3",), None, (None, 7), voxel_parts=2)
    units = _submit_stages(client, work, work.job(7))
    assert [after for _, after in client.units] == [[], [0], [0], [1, 2]]
    assert units == [0, 1, 2, 3]
    names = [[command[0], *command[10:]] for command, _ in client.units]
    assert names == [["yarns"], ["voxelize", "--part", "0/2"], ["voxelize", "--part", "1/2"], ["voxelize"]]
    common = f"{path} --output {tmp_path / 'job.out'} --progress plain --frame 7 --set render.seed=3"
    assert all(" ".join(command[1:10]) == common for command, _ in client.units)


def test_parts_of_a_volume_join_to_the_bits_of_one_run(tmp_path, capsys):
    small = KNIT.replace("voxel_size_mm = 0.2", "voxel_size_mm = 0.2\ntile_voxels = 32")
    path = job(tmp_path, small)
    one, parts = tmp_path / "one", tmp_path / "parts"
    for folder in (one, parts):
        assert exit_code(["yarns", str(path), "--output", str(folder)]) == 0
    assert exit_code(["voxelize", str(path), "--output", str(one)]) == 0
    for part in ("2/3", "0/3"):
        assert exit_code(["voxelize", str(path), "--output", str(parts), "--part", part]) == 0
    made = {file: file.stat().st_mtime_ns for file in (parts / "volume.vdb.parts").iterdir()}
    assert len(made) > 3
    assert exit_code(["voxelize", str(path), "--output", str(parts), "--part", "1/3"]) == 0
    assert all(file.stat().st_mtime_ns == when for file, when in made.items())
    assert exit_code(["voxelize", str(path), "--output", str(parts)]) == 0
    assert (parts / "volume.vdb").read_bytes() == (one / "volume.vdb").read_bytes()
    capsys.readouterr()
    assert exit_code(["voxelize", str(path), "--output", str(parts), "--part", "1/3"]) == 0
    assert capsys.readouterr().out == "voxelize: fresh\n"
    assert exit_code(["voxelize", str(path), "--output", str(parts), "--part", "3/3"]) == 2


def test_slurm_jobs_are_asked_for_through_dask_jobqueue(monkeypatch):
    """By a stand-in for the package: what it is told, and that dask's own configuration goes first."""
    told = {}

    class Cluster:
        def __init__(self, **options):
            told.update(options)

        def scale(self, jobs):
            told["jobs"] = jobs

    pytest.importorskip("dask")
    import dask

    monkeypatch.setitem(sys.modules, "dask_jobqueue", types.SimpleNamespace(SLURMCluster=Cluster))
    slurm_cluster(4)
    assert (told["jobs"], told["cores"], told["processes"], told["memory"]) == (4, 1, 1, "8GB")
    with dask.config.set({"jobqueue.slurm.cores": 12, "jobqueue.slurm.memory": "64GB"}):
        slurm_cluster(2)
    assert (told["jobs"], told["cores"], told["memory"]) == (2, 12, "64GB")
    monkeypatch.setitem(sys.modules, "dask_jobqueue", None)
    with pytest.raises(InputError, match="pip install weft"):
        slurm_cluster(1)


def test_a_slurm_job_is_a_script_that_starts_one_worker():
    jobqueue = pytest.importorskip("dask_jobqueue", reason="dask-jobqueue is an extra: weft[cluster]")
    with jobqueue.SLURMCluster(cores=3, processes=1, memory="8GB", job_name="weft") as cluster:
        script = cluster.job_script()
    assert "#SBATCH -J weft" in script
    assert "#SBATCH --cpus-per-task=3" in script


@contextmanager
def three_workers(port, folder):
    """A scheduler and its workers; gives its address and the processes, the scheduler first."""
    address = f"tcp://127.0.0.1:{port}"
    dask = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--port", str(port), "--no-dashboard"]
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-nanny"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": folder}
    processes = [subprocess.Popen([*dask, "--host", "127.0.0.1"], **quiet)]
    try:
        processes += [subprocess.Popen([*worker, "--no-dashboard"], **quiet) for _ in range(3)]
        yield address, processes
    finally:
        for process in processes:
            process.kill()
            process.wait()


def start(*arguments):
    command = [sys.executable, "-m", "weft.pipeline.cli", *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def wait_for_files(folder, pattern, process, seconds=240):
    end = time.monotonic() + seconds
    while not list(folder.glob(pattern)) and process.poll() is None and time.monotonic() < end:
        time.sleep(0.05)


@pytest.mark.proof
@pytest.mark.gl
def test_a_worker_killed_in_the_middle_changes_no_bit(fresh, tmp_path):  # noqa: F811
    pytest.importorskip("distributed")
    path, picture, out = fresh
    with three_workers(38786, tmp_path) as (address, processes):
        render = start("render", path, *SETTINGS, "--cluster", address)
        wait_for_files(out, "shares/image.b*.exr", render)
        processes[1].kill()
        _, complaint = render.communicate(timeout=300)
        assert render.returncode == 0, complaint
    channels, _ = read_exr(out / "image.exr")
    for name, data in picture.items():
        np.testing.assert_array_equal(channels[name], data, err_msg=name)


@pytest.mark.proof
@pytest.mark.gl
def test_frames_tiles_and_blocks_are_units_and_a_dead_worker_changes_no_bit(sequence, tmp_path):  # noqa: F811
    pytest.importorskip("distributed")
    out, alone = tmp_path / "cluster", tmp_path / "alone"
    with three_workers(38787, tmp_path) as (address, processes):
        cluster = ["--cluster", address, "--voxel-parts", "2"]
        run = start("run", sequence, "--frames", "1:3", "--output", out, *cluster)
        wait_for_files(out, "frame_*/volume.vdb.parts/tile*", run)
        processes[1].kill()
        wait_for_files(out, "frame_*/shares/*.exr", run)
        processes[2].kill()
        _, complaint = run.communicate(timeout=500)
        assert run.returncode == 0, complaint
    assert exit_code(["run", str(sequence), "--frames", "1:3", "--output", str(alone)]) == 0
    for frame in (1, 2, 3):
        volumes = [folder / f"frame_000{frame}" / "volume.vdb" for folder in (out, alone)]
        assert volumes[0].read_bytes() == volumes[1].read_bytes()
        one, other = (read_exr(folder / f"image.000{frame}.exr")[0] for folder in (out, alone))
        for name, data in one.items():
            np.testing.assert_array_equal(data, other[name], err_msg=name)
