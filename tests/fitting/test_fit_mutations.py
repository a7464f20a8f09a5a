"""Every fault injected into the fit turns its test red; run as the renderer's, on a copy of the checkout.

Faults in compiled code are compiled anew, half a minute of processor time each.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from tests import faults
from tests.fitting.fit_mutations import MUTATIONS


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return faults.copy_of_the_checkout(tmp_path_factory.mktemp("copy"))


@pytest.mark.parametrize("mutation", MUTATIONS, ids=faults.name_of)
def test_the_fault_has_its_place(mutation: faults.Mutation):
    faults.assert_in_place(mutation)


@pytest.mark.proof
@pytest.mark.parametrize("test", faults.tests_of(MUTATIONS))
def test_without_a_fault_it_is_green(copy: Path, test: str):
    faults.assert_green(copy, test)


@pytest.mark.proof
@pytest.mark.parametrize("mutation", MUTATIONS, ids=faults.name_of)
def test_the_fault_is_noticed(copy: Path, mutation: faults.Mutation):
    # a fit that goes astray may end in an error of its own
    faults.assert_noticed(copy, replace(mutation, sign=""))
