"""Faults injected into a copy of the checkout, to see that a test can fail, and for the reason it states."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from tests.conftest import CHECKOUT

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


@dataclass(frozen=True)
class Mutation:
    """One place in the code, what to write there instead, and who must notice."""

    name: str
    file: str
    right: str
    """Occurs once in the file."""
    wrong: str
    test: str
    sign: str = "assert"
    """What the output of the failing test holds."""


def name_of(mutation: Mutation) -> str:
    return mutation.name


def tests_of(mutations: tuple[Mutation, ...]) -> list[str]:
    """Those that must notice, each once."""
    return sorted({mutation.test for mutation in mutations})


def copy_of_the_checkout(folder: Path) -> Path:
    target = folder / "checkout"
    shutil.copytree(CHECKOUT, target, symlinks=True, ignore=shutil.ignore_patterns(*LEFT_OUT))
    return target


def assert_in_place(mutation: Mutation) -> None:
    """So that a list cannot rot unseen between proofs."""
    assert (CHECKOUT / mutation.file).read_text(encoding="utf-8").count(mutation.right) == 1
    assert (CHECKOUT / mutation.test.partition("::")[0]).is_file()


def assert_green(copy: Path, test: str) -> None:
    done = _run_test(copy, test)
    assert done.returncode == 0, done.stdout[-3000:]


def assert_noticed(copy: Path, mutation: Mutation) -> None:
    file = copy / mutation.file
    right = file.read_text(encoding="utf-8")
    file.write_text(right.replace(mutation.right, mutation.wrong), encoding="utf-8")
    try:
        done = _run_test(copy, mutation.test)
    finally:
        file.write_text(right, encoding="utf-8")
    assert done.returncode == TESTS_FAILED, done.stdout[-3000:] + done.stderr[-2000:]
    assert mutation.sign in done.stdout, done.stdout[-3000:]


def _run_test(copy: Path, test: str) -> subprocess.CompletedProcess:
    temporary = f"--basetemp={copy.parent / 'tmp'}"
    return subprocess.run(
        [sys.executable, "-c", RUN_TESTS_OF_THE_COPY, str(copy), test, temporary],
        cwd=copy,
        # a compiled module must not outlive the fault in it
        env=os.environ | {"PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        timeout=600,
    )
