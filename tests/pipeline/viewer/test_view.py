"""`weft view` in a real browser: one sees the cloth, moves the camera, and moves the sliders."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import time

import numpy as np
import pytest

from tests.pipeline.test_cli import KNIT
from tests.pipeline.viewer import chromium
from weft.pipeline.cli import exit_code

CANVAS = (slice(40, 440), slice(40, 440))
"""Rows and columns of the page that show the cloth, away from the controls."""


@pytest.fixture(scope="module")
def cloth(tmp_path_factory):
    """A job whose volume is made."""
    path = tmp_path_factory.mktemp("cloth") / "job.toml"
    path.write_text(KNIT.replace("[16, 16]", "[128, 128]"))
    assert exit_code(["voxelize", str(path)]) == 2  # no yarns yet
    assert exit_code(["yarns", str(path)]) == 0
    assert exit_code(["voxelize", str(path)]) == 0
    return path


@pytest.fixture(scope="module")
def viewer(cloth):
    """The running command, its address, and what it said."""
    command = [sys.executable, "-m", "weft.pipeline.cli", "view", str(cloth), "--port", "18231"]
    command += ["--pixels", "96", "--samples", "4"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, preexec_fn=heed_interrupts)
    found = re.search(r"http://(127\.0\.0\.1):(\d+)", process.stdout.readline())
    yield process, found[0], int(found[2])
    process.kill()
    process.wait()


def heed_interrupts():
    """Runs in the background ignore them, and so would the programs they start."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


BROWSERS_NOTICE = 150
"""Rows of the page at whose left a browser without a GPU says so."""


def seen(page):
    return page.picture()[CANVAS].astype(float)


def cloth_share(picture):
    return (picture.max(axis=-1) > 60).mean()


def settled(page, before=None, seconds=40):
    """The picture once all samples are there and it differs from `before` (unset: shows cloth)."""
    end = time.monotonic() + seconds
    while True:
        page.wait_for("/\\b4 of 4\\b/.test(document.body.innerText)")
        time.sleep(0.5)
        now = seen(page)
        other = cloth_share(now) > 0.1 if before is None else np.abs(now - before).mean() > 5
        if other or time.monotonic() > end:
            return now


def press(page, label, key):
    """A key on the slider with this label."""
    script = f"""(() => {{
        const labels = [...document.querySelectorAll('label')].filter(e => e.innerText.startsWith({label!r}));
        let box = labels[0];
        while (box && !box.querySelector('[role=slider]')) box = box.parentElement;
        box.querySelector('[role=slider]').focus();
        return true; }})()"""
    assert page.evaluate(script)
    page.press(key)


@pytest.mark.gl
@pytest.mark.skipif(chromium.PATH is None, reason="needs a browser: apt install chromium")
def test_one_sees_the_cloth_and_changes_how_it_looks(viewer, tmp_path):
    pytest.importorskip("viser")
    _, address, _ = viewer
    with chromium.page_of(address, tmp_path / "profile", size=(900, 500)) as page:
        first = settled(page)
        assert cloth_share(first) > 0.1, "no cloth to be seen"
        assert first.std() > 10

        page.drag((150, 240), (330, 200))
        turned = settled(page, first)
        assert np.abs(turned - first).mean() > 5, "the camera did not move"
        assert cloth_share(turned) > 0.05

        press(page, "Turn (deg)", "End")
        lit = settled(page, turned)
        assert np.abs(lit - turned).mean() > 5, "the light did not turn"

        press(page, "Exposure", "Home")
        dark = settled(page, lit)
        below = slice(BROWSERS_NOTICE, None)
        assert dark[below].mean() < 0.2 * lit[below].mean(), "eight stops less and not dark"


@pytest.mark.gl
def test_only_this_machine_reaches_the_page_and_an_interrupt_ends_it(viewer):
    pytest.importorskip("viser")
    process, _, port = viewer
    socket.create_connection(("127.0.0.1", port), timeout=5).close()
    with pytest.raises(OSError, match=r"refused|timed out"):
        socket.create_connection(("127.0.0.2", port), timeout=5)
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=120) == 0


def test_without_viser_one_line_says_what_to_install(cloth, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "viser", None)
    assert exit_code(["view", str(cloth)]) == 2
    error = capsys.readouterr().err
    assert "weft view needs a package that is not installed: viser. pip install 'weft[view]'" in error
    assert error.count("\n") == 1


def test_without_a_volume_one_line_says_what_to_run(tmp_path, capsys):
    path = tmp_path / "job.toml"
    path.write_text(KNIT)
    assert exit_code(["view", str(path)]) == 2
    assert "volume.vdb does not exist yet" in capsys.readouterr().err
    assert not os.path.exists(tmp_path / "job.out")
