"""Fixtures shared by all rooms."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

# the hundreds of processes that tests start would compile every module anew
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

CHECKOUT = Path(__file__).resolve().parent.parent
SHARED_DATA = CHECKOUT.parent / "shared" / "data"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real inputs beside the checkout; the test is skipped, and counted, where it is absent."""
    if not SHARED_DATA.is_dir():
        pytest.skip("no real inputs: ../shared/data is absent")
    return SHARED_DATA
