"""Every injected fault turns its test red: the tests can fail, and for the reason they state.

Each fault is written into a copy of the checkout, whose tests then run against that copy. A test that fails
by chance would hide a blind one: each alone fails by chance below 1e-3, all together below 3 %.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import CHECKOUT

from .mutations import TRACKING_MUTATIONS, Mutation
from .mutations_of_interruptions import INTERRUPTION_MUTATIONS
from .mutations_of_media import MEDIA_MUTATIONS
from .mutations_of_surfaces import SURFACE_MUTATIONS

MUTATIONS = (*TRACKING_MUTATIONS, *SURFACE_MUTATIONS, *MEDIA_MUTATIONS, *INTERRUPTION_MUTATIONS)
LEFT_OUT = (".git", ".venv", "build", "pictures", "*.png", "__pycache__", ".*_cache", "*.out")
RUN_TESTS_OF_THE_COPY = """
import sys
sys.meta_path = [finder for finder in sys.meta_path if "editable" not in type(finder).__module__.lower()]
sys.path[:0] = [".editable", "."]
import pytest
import weft.renderer.scene
assert weft.renderer.scene.__file__.startswith(sys.argv[1]), weft.renderer.scene.__file__
sys.exit(pytest.main(["-x", "-q", "-p", "no:cacheprovider", *sys.argv[2:]]))
"""
TESTS_FAILED = 1
"""pytest's exit code; errors of collection or usage have others."""


@pytest.mark.parametrize("mutation", MUTATIONS, ids=lambda one: one.name)
def test_the_fault_has_its_place(mutation: Mutation):
    """So that the list cannot rot unseen between proofs."""
    assert (CHECKOUT / mutation.file).read_text(encoding="utf-8").count(mutation.right) == 1
    assert (CHECKOUT / mutation.test.partition("::")[0]).is_file()


def test_there_are_at_least_twenty():
    assert len(MUTATIONS) >= 20
    assert len(INTERRUPTION_MUTATIONS) >= 20


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("copy") / "checkout"
    shutil.copytree(CHECKOUT, target, symlinks=True, ignore=shutil.ignore_patterns(*LEFT_OUT))
    return target


def run_test(copy: Path, test: str) -> subprocess.CompletedProcess:
    command = [
        sys.executable,
        "-c",
        RUN_TESTS_OF_THE_COPY,
        str(copy),
        test,
        f"--basetemp={copy.parent / 'tmp'}",
    ]
    return subprocess.run(command, cwd=copy, capture_output=True, text=True, timeout=600)


@pytest.mark.proof
@pytest.mark.gl
@pytest.mark.parametrize("test", sorted({one.test for one in MUTATIONS}))
def test_without_a_fault_it_is_green(copy: Path, test: str):
    done = run_test(copy, test)
    assert done.returncode == 0, done.stdout[-3000:]


@pytest.mark.proof
@pytest.mark.gl
@pytest.mark.parametrize("mutation", MUTATIONS, ids=lambda one: one.name)
def test_the_fault_is_noticed(copy: Path, mutation: Mutation):
    file = copy / mutation.file
    right = file.read_text(encoding="utf-8")
    file.write_text(right.replace(mutation.right, mutation.wrong), encoding="utf-8")
    try:
        done = run_test(copy, mutation.test)
    finally:
        file.write_text(right, encoding="utf-8")
    assert done.returncode == TESTS_FAILED, done.stdout[-3000:] + done.stderr[-2000:]
    assert mutation.sign in done.stdout, done.stdout[-3000:]
