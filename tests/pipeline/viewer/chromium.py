"""A real browser without a screen, steered through its DevTools protocol; no driver package is needed."""

from __future__ import annotations

import base64
import io
import json
import re
import shutil
import subprocess
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

PATH = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
SOFTWARE_GL = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
PATIENCE_SECONDS = 60


class Page:
    """One page of the browser."""

    def __init__(self, socket: Any) -> None:
        self.socket, self.number = socket, 0

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self.number += 1
        self.socket.send(json.dumps({"id": self.number, "method": method, "params": parameters}))
        while True:
            answer = json.loads(self.socket.recv(timeout=PATIENCE_SECONDS))
            if answer.get("id") == self.number:
                assert "error" not in answer, answer
                return answer["result"]

    def evaluate(self, script: str) -> Any:
        return self.call("Runtime.evaluate", expression=script, returnByValue=True)["result"].get("value")

    def wait_for(self, script: str, seconds: float = PATIENCE_SECONDS) -> Any:
        """What the script gives once that is truthy."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if value := self.evaluate(script):
                return value
            time.sleep(0.05)
        raise AssertionError(f"not within {seconds} s: {script}; the page says: {self.text()!r}")

    def text(self) -> str:
        return self.evaluate("document.body.innerText") or ""

    def picture(self) -> np.ndarray:
        """What the page looks like, uint8, shape [height, width, 3]."""
        data = base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])
        return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))

    def drag(self, start: tuple[int, int], end: tuple[int, int], steps: int = 6) -> None:
        """With the left button."""
        self._mouse("mouseMoved", *start)
        self._mouse("mousePressed", *start)
        for i in range(1, steps + 1):
            x, y = (round(a + (b - a) * i / steps) for a, b in zip(start, end, strict=True))
            self._mouse("mouseMoved", x, y, held=True)
        self._mouse("mouseReleased", *end)

    def click(self, x: float, y: float) -> None:
        self._mouse("mouseMoved", x, y)
        self._mouse("mousePressed", x, y)
        self._mouse("mouseReleased", x, y)

    def press(self, key: str) -> None:
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, code=key)

    def _mouse(self, kind: str, x: float, y: float, *, held: bool = False) -> None:
        pressed = kind in ("mousePressed", "mouseReleased")
        button = "left" if pressed or held else "none"
        buttons = int(kind == "mousePressed" or held)
        self.call(
            "Input.dispatchMouseEvent", type=kind, x=x, y=y, button=button, buttons=buttons, clickCount=1
        )


@contextmanager
def page_of(address: str, profile: Path, size: tuple[int, int] = (1000, 640)) -> Iterator[Page]:
    """The page at an address in a browser of its own."""
    from websockets.sync.client import connect

    width, height = size
    command = [
        PATH, "--headless=new", f"--user-data-dir={profile}", "--no-sandbox", "--disable-dev-shm-usage",
        *SOFTWARE_GL, "--no-first-run", "--mute-audio", f"--window-size={width},{height}",
        "--remote-debugging-port=0", "about:blank",
    ]  # fmt: skip
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    try:
        with connect(_first_page(process), max_size=None) as socket:
            page = Page(socket)
            page.call(
                "Emulation.setDeviceMetricsOverride",
                width=width,
                height=height,
                deviceScaleFactor=1,
                mobile=False,
            )
            page.call("Page.navigate", url=address)
            yield page
    finally:
        process.terminate()
        process.wait(timeout=20)


def _first_page(process: subprocess.Popen[str]) -> str:
    """The address of the page's socket, once the browser told the port of its DevTools."""
    for line in process.stderr:
        if found := re.search(r"ws://127\.0\.0\.1:(\d+)/", line):
            break
    else:
        raise AssertionError("the browser did not start")
    with urllib.request.urlopen(f"http://127.0.0.1:{found[1]}/json/list", timeout=20) as answer:
        pages = [entry for entry in json.load(answer) if entry["type"] == "page"]
    return pages[0]["webSocketDebuggerUrl"]
