"""What runs, what is skipped and why, and what is left after a failure."""

from __future__ import annotations

import io
import json
import os
import signal
import subprocess
import sys

import pytest

from weft.files.errors import InputError
from weft.pipeline.cache import _content_hash
from weft.pipeline.progress import PlainReporter
from weft.pipeline.run import run_chain, run_one
from weft.pipeline.run_record import parse_record
from weft.pipeline.stage import Stage


class Runs:
    """Runs jobs of a folder and keeps what was said."""

    def __init__(self, folder, chain):
        self.folder, self.chain = folder, chain

    def run(self, *overrides, targets=("cloth",), force=False, chain=None):
        self.text = io.StringIO()
        _content_hash.cache_clear()
        report = PlainReporter(self.text)
        job = self.folder.load(*overrides)
        outcomes = run_chain(job, chain or self.chain, list(targets), report=report, force=force)
        return {outcome.stage: outcome.why for outcome in outcomes}

    def run_one(self, target, *overrides):
        self.text = io.StringIO()
        job = self.folder.load(*overrides)
        outcome = run_one(job, self.chain, target, report=PlainReporter(self.text))
        return outcome.why


@pytest.fixture
def runs(folder, chain):
    return Runs(folder, chain)


FRESH = {"thread": "", "cloth": ""}


def test_first_run_makes_everything_and_second_nothing(runs):
    first = runs.run()
    assert first == {"thread": "thread.txt does not exist yet", "cloth": "cloth.txt does not exist yet"}
    assert (runs.folder.output / "cloth.txt").read_text() == "red wool wool wool "
    assert (
        "thread: stale because thread.txt does not exist yet\nthread: 3 strands (0.0 s)"
        in runs.text.getvalue()
    )
    assert runs.run() == FRESH
    assert runs.text.getvalue() == "thread: fresh\ncloth: fresh\n"


def test_a_changed_key_is_named_and_earlier_stages_stay_fresh(runs):
    runs.run()
    assert runs.run("cloth.color=blue") == {
        "thread": "",
        "cloth": 'cloth.color changed from "red" to "blue"',
    }
    assert runs.run("cloth.color=blue", "thread.strands=4") == {
        "thread": "thread.strands changed from 3 to 4",
        "cloth": "thread changed",
    }


def test_content_of_input_files_counts_and_neither_their_place_nor_their_time(runs):
    runs.run()
    fleece = runs.folder.path / "fleece.txt"
    os.utime(fleece, (1, 1))
    assert runs.run() == FRESH
    runs.folder.write("moved/fleece.txt", "wool ")
    assert runs.run("thread.file=" + str(runs.folder.path / "moved/fleece.txt")) == FRESH
    fleece.write_text("alpaca ")
    assert runs.run() == {"thread": "thread.file changed", "cloth": "thread changed"}


def test_an_earlier_stage_that_makes_the_same_file_again_leaves_later_ones_fresh(runs):
    runs.run()
    assert runs.run("thread.seed=7") == {"thread": "thread.seed changed from 0 to 7", "cloth": ""}


def test_a_comment_changes_nothing(runs):
    runs.run()
    runs.folder.job_path.write_text("# new\n" + runs.folder.job_path.read_text())
    assert runs.run() == FRESH


def test_a_result_that_was_changed_or_lost_is_made_again(runs):
    runs.run()
    cloth = runs.folder.output / "cloth.txt"
    cloth.write_text("green")
    assert runs.run() == {"thread": "", "cloth": "cloth.txt was changed after it was made"}
    cloth.unlink()
    assert runs.run() == {"thread": "", "cloth": "cloth.txt is gone"}
    (runs.folder.output / "cloth.run.json").write_text("{}")
    assert runs.run() == {"thread": "", "cloth": "there is no run record beside it"}


def test_changed_code_makes_stale(runs, monkeypatch):
    runs.run()
    monkeypatch.setattr("weft.pipeline.cache.code_fingerprint", lambda part: "sha256:other")
    assert runs.run()["thread"] == "code of files changed"


def test_force_runs_what_is_fresh_and_results_are_bitwise_equal(runs):
    runs.run()
    before = [(runs.folder.output / name).read_bytes() for name in ("thread.txt", "cloth.txt")]
    assert runs.run(force=True) == {"thread": "you asked for it", "cloth": "you asked for it"}
    assert [(runs.folder.output / name).read_bytes() for name in ("thread.txt", "cloth.txt")] == before


def test_one_stage_alone_uses_what_is_there(runs):
    with pytest.raises(InputError) as caught:
        runs.run_one("cloth")
    job = runs.folder.job_path
    assert str(caught.value) == (
        f"cloth: {runs.folder.output}/thread.txt does not exist yet. "
        f"Run 'weft thread {job}', or 'weft run {job}' for all."
    )
    runs.run_one("thread")
    runs.run_one("cloth")
    runs.run_one("cloth", "thread.strands=9")
    assert runs.text.getvalue().startswith(
        "note: thread.txt is used as it is, but it is stale: thread.strands changed from 3 to 9\n"
    )
    assert (runs.folder.output / "cloth.txt").read_text() == "red wool wool wool "


def test_a_file_named_by_the_job_replaces_the_earlier_stage(runs):
    runs.folder.write("mine.txt", "my thread")
    runs.folder.job_path.write_text('[cloth]\ncolor = "red"\nthread = "mine.txt"\n')
    assert list(runs.run()) == ["cloth"]
    assert (runs.folder.output / "cloth.txt").read_text() == "red my thread"


def test_a_stage_without_its_table_is_refused(runs):
    runs.folder.job_path.write_text('[cloth]\ncolor = "red"\n')
    with pytest.raises(
        InputError, match=r"job\.toml: 'thread' needs the table \[thread\], which the job lacks"
    ):
        runs.run()


def test_the_record_says_how_the_result_came_to_be(runs):
    runs.run()
    record = parse_record(runs.folder.output / "thread.run.json")
    assert record.config["thread"]["strands"] == 3
    assert record.inputs["thread.file"].path == str(runs.folder.path / "fleece.txt")
    assert record.outputs["thread"].path == "thread.txt"
    assert record.report == {"summary": "3 strands", "strands": 3}
    assert record.seeds == {"thread.seed": 0}
    assert record.machine["cores"] >= 1
    assert {"python", "weft", "numpy"} <= set(record.versions)


def test_a_stage_that_fails_leaves_previous_results_and_no_leftovers(runs, chain):
    runs.run()

    def fail(work):
        from weft.files.atomic import atomic_write

        with atomic_write(work.outputs["cloth"]) as temporary:
            temporary.write_text("half")
            raise InputError("yarn 3 has 1 point")

    broken = {
        **chain,
        "cloth": Stage("cloth", ("cloth",), chain["cloth"].inputs, chain["cloth"].outputs, fail),
    }
    before = {file: (runs.folder.output / file).read_bytes() for file in os.listdir(runs.folder.output)}
    with pytest.raises(InputError, match="yarn 3"):
        runs.run("cloth.color=blue", chain=broken)
    assert {
        file: (runs.folder.output / file).read_bytes() for file in os.listdir(runs.folder.output)
    } == before
    assert runs.run() == FRESH


KILLED = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[2])
import conftest
from weft.files.atomic import atomic_write
from weft.pipeline.job import load_job
from weft.pipeline.progress import reporter
from weft.pipeline.run import run_chain
from weft.pipeline.stage import Stage
import time

def slow(work):
    with atomic_write(work.outputs["cloth"]) as temporary:
        with open(temporary, "w") as file:
            file.write("half"); file.flush()
            print("writing", flush=True)
            time.sleep(60)

cloth = conftest.CLOTH
slow_cloth = Stage("cloth", ("cloth",), cloth.inputs, cloth.outputs, slow)
job = load_job(Path(sys.argv[1]), ["cloth.color=blue"], model=conftest.SmallJob)
run_chain(job, {"thread": conftest.THREAD, "cloth": slow_cloth}, ["cloth"], report=reporter("plain"))
"""


def test_kill_9_leaves_previous_results_and_the_next_run_cleans_up(runs):
    runs.run()
    arguments = [sys.executable, "-c", KILLED, str(runs.folder.job_path), os.path.dirname(__file__)]
    process = subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "writing\n"
    with pytest.raises(InputError, match="another weft run is working in this folder"):
        runs.run()
    process.send_signal(signal.SIGKILL)
    process.wait(timeout=10)
    process.stdout.close()
    left = [name for name in os.listdir(runs.folder.output) if name.startswith(".cloth.")]
    assert len(left) == 1
    assert (runs.folder.output / "cloth.txt").read_text() == "red wool wool wool "
    assert runs.run() == FRESH
    assert not [name for name in os.listdir(runs.folder.output) if name.startswith(".cloth.")]


def test_records_of_another_kind_are_refused(tmp_path):
    for text in ("", "[]", '{"format": "weft run record"}', '{"format": "other"}', "[" * 100000):
        (tmp_path / "a.run.json").write_text(text)
        with pytest.raises(InputError):
            parse_record(tmp_path / "a.run.json")


def test_the_key_in_the_record_is_json_of_plain_values(runs):
    runs.run()
    key = json.loads((runs.folder.output / "thread.run.json").read_text())["key"]
    assert key["thread.size_mm"] == [1.0, 2.0]
    assert key["thread.file"].startswith(".txt sha256:")


def test_a_refused_run_leaves_no_folder_and_a_run_no_lock(runs):
    with pytest.raises(InputError, match="does not exist yet"):
        runs.run_one("cloth")
    assert not runs.folder.output.exists()
    runs.run()
    assert not (runs.folder.output / ".lock").exists()
    (runs.folder.output / "thread.txt").unlink()
    with pytest.raises(InputError, match="does not exist yet"):
        runs.run_one("cloth")
    assert (runs.folder.output / "cloth.txt").exists()
