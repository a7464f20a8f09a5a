"""setup.sh on machines where packages are missing; apt, dpkg, pip and Python are small stand-ins."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[1]
PYTHON = """#!/bin/sh
case "$*" in
  *"-m venv"*) mkdir -p .venv/bin && cp "$0" .venv/bin/python ;;
  *"pip install"*) echo pip >> log ;;
esac
"""
TOOLS = {
    "python": PYTHON,
    "id": "#!/bin/sh\necho 0\n",
    "dpkg-query": '#!/bin/sh\nfor name; do :; done\ngrep -qx "$name" absent || echo "install ok installed"\n',
    # as apt does, it takes all of the list or none
    "apt-get": """#!/bin/sh
[ "$1" = install ] || exit 0
shift
for name; do grep -qx -e "$name" unknown && exit 100; done
for name; do grep -vx -e "$name" absent > rest; mv rest absent; done
exit 0
""",
}


@pytest.fixture
def machine(tmp_path):
    """A copy of what set-up reads, and tools that note what they do; returns a way to run it."""
    for name in ("setup.sh", "pyproject.toml"):
        shutil.copy(CHECKOUT / name, tmp_path)
    for name in ("openvdb_extension", "tile_extension"):
        shutil.copytree(CHECKOUT / "voxelize" / name, tmp_path / "voxelize" / name)
    shutil.copy(CHECKOUT / "voxelize" / "CMakeLists.txt", tmp_path / "voxelize")
    (tmp_path / "tools").mkdir()
    for name, text in TOOLS.items():
        (tmp_path / "tools" / name).write_text(text)
        (tmp_path / "tools" / name).chmod(0o755)
    for name in ("absent", "unknown", "log"):
        (tmp_path / name).touch()

    def run():
        path = f"{tmp_path / 'tools'}:{os.environ['PATH']}"
        environment = os.environ | {"PATH": path, "PYTHON": str(tmp_path / "tools" / "python")}
        done = subprocess.run(
            ["bash", "setup.sh"], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=60
        )
        assert done.returncode == 0, done.stderr
        return done.stderr

    run.folder = tmp_path
    return run


def installs(folder):
    return (folder / "log").read_text().count("pip")


def test_second_time_does_nothing(machine):
    machine()
    assert machine() == ""
    assert installs(machine.folder) == 1


def test_packages_that_apt_does_not_know_do_not_keep_away_the_others(machine):
    (machine.folder / "absent").write_text("libegl1\npython3-openvdb\nlibopenvdb-dev\n")
    (machine.folder / "unknown").write_text("python3-openvdb\n")
    said = machine()
    assert (machine.folder / "absent").read_text() == "python3-openvdb\n"
    assert "sudo apt-get install python3-openvdb\n" in said
    assert machine() == ""


def test_weft_is_built_anew_once_a_missing_package_is_there(machine):
    (machine.folder / "absent").write_text("libopenvdb-dev\n")
    (machine.folder / "unknown").write_text("libopenvdb-dev\n")
    machine()
    assert machine() == ""
    (machine.folder / "absent").write_text("")
    machine()
    assert installs(machine.folder) == 2
