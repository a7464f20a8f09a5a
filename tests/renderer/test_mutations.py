"""Every injected fault turns its test red: the tests can fail, and for the reason they state.

Each fault is written into a copy of the checkout, whose tests then run against that copy. A test that fails
by chance would hide a blind one: each alone fails by chance below 1e-3, all together below 3 %.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests import faults

from .mutations import TRACKING_MUTATIONS
from .mutations_of_interruptions import INTERRUPTION_MUTATIONS
from .mutations_of_media import MEDIA_MUTATIONS
from .mutations_of_surfaces import SURFACE_MUTATIONS

MUTATIONS = (*TRACKING_MUTATIONS, *SURFACE_MUTATIONS, *MEDIA_MUTATIONS, *INTERRUPTION_MUTATIONS)


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return faults.copy_of_the_checkout(tmp_path_factory.mktemp("copy"))


@pytest.mark.parametrize("mutation", MUTATIONS, ids=faults.name_of)
def test_the_fault_has_its_place(mutation: faults.Mutation):
    faults.assert_in_place(mutation)


def test_there_are_at_least_twenty():
    assert len(MUTATIONS) >= 20
    assert len(INTERRUPTION_MUTATIONS) >= 20


@pytest.mark.proof
@pytest.mark.gl
@pytest.mark.parametrize("test", faults.tests_of(MUTATIONS))
def test_without_a_fault_it_is_green(copy: Path, test: str):
    faults.assert_green(copy, test)


@pytest.mark.proof
@pytest.mark.gl
@pytest.mark.parametrize("mutation", MUTATIONS, ids=faults.name_of)
def test_the_fault_is_noticed(copy: Path, mutation: faults.Mutation):
    faults.assert_noticed(copy, mutation)
