"""Every fault injected into the fit turns its test red; run as the renderer's, on a copy of the checkout.

Faults in compiled code are compiled anew, half a minute of processor time each.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.conftest import CHECKOUT
from tests.fitting.fit_mutations import MUTATIONS
from tests.renderer.mutations import Mutation
from tests.renderer.test_mutations import TESTS_FAILED, copy, run_test

__all__ = ["copy"]


@pytest.mark.parametrize("mutation", MUTATIONS, ids=lambda one: one.name)
def test_the_fault_has_its_place(mutation: Mutation):
    assert (CHECKOUT / mutation.file).read_text(encoding="utf-8").count(mutation.right) == 1
    assert (CHECKOUT / mutation.test.partition("::")[0]).is_file()


@pytest.mark.proof
@pytest.mark.parametrize("test", sorted({one.test for one in MUTATIONS}))
def test_without_a_fault_it_is_green(copy: Path, test: str):
    done = run_test(copy, test)
    assert done.returncode == 0, done.stdout[-3000:]


@pytest.mark.proof
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
