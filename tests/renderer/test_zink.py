"""The renderer on a second driver: zink, Mesa's OpenGL over Vulkan, on lavapipe, its Vulkan on the processor.

The driver is chosen when a process opens its context, so the tests run in a process of their own.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import CHECKOUT

pytestmark = pytest.mark.gl

DRIVERS = sorted(Path("/usr/share/vulkan/icd.d").glob("lvp_icd*.json"))
ON_ZINK = [
    "tests/renderer/test_tracking.py::test_free_flight_distribution",
    "tests/renderer/test_transport.py::test_white_furnace[1.0-reference]",
    "tests/renderer/test_transport.py::test_single_scattering_in_a_slab[90.0-1.0]",
    "tests/renderer/test_kernel.py::test_delta_tracking_is_as_deterministic",
    "tests/renderer/shaders/test_rng.py",
]
RUN = """
import sys
import pytest
from weft.renderer.gpu.context import device_name, shared_context
print(device_name(shared_context()))
assert "zink" in device_name(shared_context())
sys.exit(pytest.main(["-q", "-x", "-p", "no:cacheprovider", *sys.argv[1:]]))
"""


@pytest.mark.skipif(not DRIVERS, reason="mesa-vulkan-drivers is not installed")
def test_the_same_statements_hold_on_zink(tmp_path: Path):
    environment = os.environ | {
        "MESA_LOADER_DRIVER_OVERRIDE": "zink",
        "LIBGL_ALWAYS_SOFTWARE": "1",
        "VK_ICD_FILENAMES": str(DRIVERS[0]),
        "VK_DRIVER_FILES": str(DRIVERS[0]),
    }
    command = [sys.executable, "-c", RUN, *ON_ZINK, f"--basetemp={tmp_path / 'pytest'}"]
    done = subprocess.run(command, cwd=CHECKOUT, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-1000:]
